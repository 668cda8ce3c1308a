// Stands for Web Serial in a browser without ports, in the window and in workers: one USB port, whose other side the test
// has. A page sees no more than the standard's interface, and each rule that the standard has holds here, too. The line
// takes its time: a write is done when its last byte has left.
(() => {
  const ORIGIN = "http://127.0.0.1:@PORT@";
  const WIRE = `${ORIGIN.replace("http", "ws")}/wire`;
  const INFO = { usbVendorId: 0x1a86, usbProductId: 0x55d3 };

  class DoublePort extends EventTarget {
    connected = true;
    onconnect = null;
    ondisconnect = null;
    #socket = null;
    #readable = null;
    #writable = null;
    #input = null; // the controller of `readable`
    #output = null;
    #options = null;
    #acknowledged = [];

    getInfo() {
      return { ...INFO };
    }
    get readable() {
      return this.#readable;
    }
    get writable() {
      return this.#writable;
    }

    async open(options) {
      if (this.#socket) throw new DOMException("The port is already open.", "InvalidStateError");
      const { baudRate, dataBits = 8, stopBits = 1, parity = "none", bufferSize = 255, flowControl = "none" } = options;
      if (!(baudRate > 0) || ![7, 8].includes(dataBits) || ![1, 2].includes(stopBits))
        throw new TypeError("Failed to execute 'open' on 'SerialPort': an option is out of its range.");
      if (!["none", "even", "odd"].includes(parity) || !["none", "hardware"].includes(flowControl) || !(bufferSize > 0))
        throw new TypeError("Failed to execute 'open' on 'SerialPort': an option is no such value.");
      const socket = new WebSocket(`${WIRE}?baud=${baudRate}`);
      socket.binaryType = "arraybuffer";
      const failed = new DOMException("Failed to open serial port.", "NetworkError");
      if (!this.connected) throw failed;
      await new Promise((resolve, reject) => {
        socket.onopen = resolve;
        socket.onclose = socket.onerror = () => reject(failed);
      });
      this.#socket = socket;
      this.#options = options;
      socket.onmessage = ({ data }) => {
        if (typeof data === "string") this.#acknowledged.shift()?.resolve();
        else if (this.#input) this.#input.enqueue(new Uint8Array(data));
      };
      socket.onclose = () => this.#lost();
      this.#readable = new ReadableStream(
        { start: (controller) => (this.#input = controller), cancel: () => (this.#input = null) },
        { highWaterMark: bufferSize },
      );
      this.#writable = new WritableStream({
        start: (controller) => (this.#output = controller),
        write: (chunk) => {
          if (!(chunk instanceof Uint8Array) && !(chunk instanceof ArrayBuffer))
            throw new TypeError("Failed to execute 'write' on 'UnderlyingSinkBase': the chunk is not a BufferSource.");
          const done = new Promise((resolve, reject) => this.#acknowledged.push({ resolve, reject }));
          socket.send(chunk);
          globalThis.bytesWritten += chunk.byteLength; // for tests
          return done;
        },
      });
    }

    async close() {
      if (!this.#socket) throw new DOMException("The port is already closed.", "InvalidStateError");
      if (this.#readable?.locked || this.#writable?.locked)
        throw new TypeError("Cannot cancel a locked stream");
      const socket = this.#socket;
      await Promise.allSettled([this.#readable?.cancel(), this.#writable?.abort()]);
      this.#forget();
      socket.onclose = null;
      socket.close();
    }

    #forget() {
      this.#socket = this.#readable = this.#writable = this.#input = this.#output = null;
    }

    #lost() {
      const why = new DOMException("The device has been lost.", "NetworkError");
      this.#input?.error(why);
      this.#output?.error(why);
      for (const { reject } of this.#acknowledged.splice(0)) reject(why);
      this.#readable = this.#writable = this.#input = this.#output = null;
    }

    plug(isThere) {
      if (this.connected === isThere) return;
      this.connected = isThere;
      const event = new Event(isThere ? "connect" : "disconnect", { bubbles: true });
      this.dispatchEvent(event);
      Object.defineProperty(event, "target", { value: this });
      serial.dispatchEvent(new Event(event.type));
    }
  }

  class DoubleSerial extends EventTarget {
    async getPorts() {
      const isGranted = await fetch(`${ORIGIN}/granted`).then((answer) => answer.json());
      return isGranted ? [port] : [];
    }
    async requestPort() {
      if (!globalThis.navigator.userActivation?.isActive)
        throw new DOMException("Must be handling a user gesture to show a permission request.", "SecurityError");
      await fetch(`${ORIGIN}/granted`, { method: "POST" }); // the permission is the origin's: workers have it, too
      return port;
    }
  }

  globalThis.bytesWritten = 0;
  const port = new DoublePort();
  const serial = new DoubleSerial();
  const watch = new WebSocket(WIRE.replace("/wire", "/plug"));
  watch.onmessage = ({ data }) => port.plug(data === "in");
  Object.defineProperty(globalThis.navigator, "serial", { value: serial, configurable: true });
})();
