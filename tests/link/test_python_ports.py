"""Faults of a port that pyserial opens, below the common part of all links."""

from __future__ import annotations

import errno
import termios
from typing import Any

import pytest

from wirebond.errors import PortError
from wirebond.link.devices.port_name import port_name
from wirebond.link.python_ports import LineSettings, PythonOpener
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live


def test_a_tty_that_goes_away_while_it_is_set_up_is_a_port_that_cannot_be_opened(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    port = PtyPort()
    opener = PythonOpener(port_name(port.path), LineSettings(115_200, 8, "none", 1), 0.01)

    def set_up(*_: Any) -> None:
        raise termios.error(errno.EIO, "Input/output error")

    with monkeypatch.context() as patch:
        patch.setattr("termios.tcsetattr", set_up)
        with pytest.raises(PortError, match="Input/output error") as caught:
            opener.open()
    assert caught.value.errno == errno.EIO
    opener.open().close()
    port.close()
