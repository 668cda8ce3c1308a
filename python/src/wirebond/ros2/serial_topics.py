"""Frames as topics: what is received and sent, as bytes and in hex; and frames that a topic brings, to be sent."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from wirebond.errors import WirebondError
from wirebond.protocol.model import End
from wirebond.ros2.node import Publisher, Qos

if TYPE_CHECKING:
    from wirebond.codec import Message
    from wirebond.link import Link
    from wirebond.link.tap import Tap
    from wirebond.ros2.commands import Commands

_TAP_BYTES = 1 << 18  # that wait for the bridge: 2 s of both directions at 2 Mbaud
_BYTES = "std_msgs/UInt8MultiArray"


class SerialTopics:
    """The topics ``serial_rx_data``, ``serial_rx_hex``, ``serial_tx_hex``, and from ROS ``serial_tx_data``.

    :ivar frames: of ``serial_tx_data``.
    :ivar unknown_frames: of them those whose id the file does not know.
    :ivar undecodable: bytes of ``serial_tx_data`` that are not a frame, by cause.
    """

    def __init__(
        self,
        link: Link,
        commands: Commands,
        publisher: Callable[[str, str, Qos], Publisher],
        subscribe: Callable[[str, str, Qos, Callable[[dict[str, Any]], None]], None],
    ) -> None:
        self.frames = self.unknown_frames = 0
        self.undecodable: Counter[str] = Counter()
        self._codec = link.codec
        self._commands = commands
        self._rx_data = publisher("serial_rx_data", _BYTES, Qos())
        self._rx_hex = publisher("serial_rx_hex", "std_msgs/String", Qos())
        self._tx_hex = publisher("serial_tx_hex", "std_msgs/String", Qos())
        subscribe("serial_tx_data", _BYTES, Qos(), self._send)
        self._link = link
        self._tap: Tap | None = None
        self._sent = self._codec.decoder(sender="host")

    def take_received(self, message: Message) -> None:
        """Publish a received message, of known id or not."""
        self._rx_data.publish({"data": message.raw})
        self._rx_hex.publish({"data": f"RX: {message.raw.hex(' ')}"})

    def take_sent(self) -> None:
        """Process what the link sent since the last call. If the server restarted, its tap is gone, and a new one is
        opened."""
        try:
            if self._tap is None:
                self._tap = self._link.tap(_TAP_BYTES)
                self._sent = self._codec.decoder(sender="host")
            pieces = self._tap.take().pieces
        except WirebondError:
            self._tap = None
            return
        for piece in pieces:
            data: bytes | None = getattr(piece, "bytes", None)
            if data is None or getattr(piece, "direction", "") != "sent":
                continue
            for message in self._sent.feed(data, t=piece.t):
                self._tx_hex.publish({"data": f"TX: {message.raw.hex(' ')}"})

    def _send(self, values: dict[str, Any]) -> None:
        """Send frames of the host as messages, under the rules of all others; other bytes are refused."""
        decoder = self._codec.decoder(sender="host")
        data = bytes(values["data"])
        messages = [*decoder.feed(data, t=time.monotonic()), *decoder.finish()]
        self.frames += len(messages)
        for message in messages:
            if message.sender in (End.HOST, End.BOTH):
                self._commands.send(message.name, message.fields, header=message.header or None)
            else:
                self.unknown_frames += 1
                self._commands.refuse(
                    "serial_tx_data", f"its frame has the id {message.id:#x}, which the file does not know"
                )
        discarded = {cause: count for cause, count in decoder.stats.discarded_bytes.items() if count}
        self.undecodable.update(discarded)
        if lost := sum(discarded.values()):
            self._commands.refuse(
                "serial_tx_data", f"{lost} of its {len(data)} bytes are not a frame of {self._codec.name}"
            )
