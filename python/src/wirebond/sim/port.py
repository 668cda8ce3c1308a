"""The port ``sim:``: a virtual MCU in a thread of this process, on a pty that a link opens."""

from __future__ import annotations

import logging
import threading
import time

from wirebond.codec import Codec
from wirebond.sim.pty_port import PtyPort, run
from wirebond.sim.virtual_mcu import VirtualMcu

NAME = "sim:"

_TURN = 0.05  # seconds until it sees that it shall end
_logger = logging.getLogger("wirebond")


class SimulatedPort:
    """``path`` is what a link opens. Its thread shares the interpreter with the program: one that computes without a
    pause makes it late."""

    def __init__(self, codec: Codec) -> None:
        self._pty = PtyPort()
        self.path = self._pty.path
        self._ends = threading.Event()
        mcu = VirtualMcu(codec, time.monotonic())
        self._thread = threading.Thread(target=self._serve, args=(mcu,), name="wirebond-sim", daemon=True)
        self._thread.start()

    def _serve(self, mcu: VirtualMcu) -> None:
        try:
            while not self._ends.is_set():
                run(mcu, self._pty, time.monotonic() + _TURN, lambda event: _logger.info("sim: %s", event))
        finally:
            self._pty.close()

    def close(self) -> None:
        """Close the port. A second call does nothing. Any thread, even its own if that collects the link as garbage."""
        self._ends.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout=1.0)
