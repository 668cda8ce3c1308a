"""The rules of the emergency stop among a server's clients: who stopped the robot, and who may release it."""

from __future__ import annotations

import logging
import time
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from wirebond.errors import StoppedByOtherError
from wirebond.link.stop_file import StopFile
from wirebond.protocol.model import End
from wirebond.seldom import Seldom, and_more

if TYPE_CHECKING:
    from wirebond.link import Link

_log = logging.getLogger("wirebond.server")
OWNER = "the program that owns the link"
_EARLIER = 0  # in the place of a client's number: an earlier server, or the owner of the link


class Presser(Protocol):
    """A client of the server, as the stop knows it."""

    number: int
    name: str


class StopBook:
    """One thread at a time. A stop that an earlier server left is latched at once, and sent.

    :param path: of the server's socket; the stop is kept beside it.
    """

    def __init__(self, link: Link, path: str | None) -> None:
        self._link = link
        self._file = StopFile(None if path is None else f"{path}.stop")
        self._stops: dict[int, str] = {}  # by the number of the client
        self._reports = Seldom()  # of releases over another program
        found = self._file.read()
        if found is None:
            return
        if not link.codec.model.emergency_stop or link.role != End.HOST:
            _log.warning(
                "%s stopped the robot, and the stop has not been released; this server cannot hold it, because %s "
                "has no emergency_stop. Look at the robot; %s.stop keeps the stop for a server that can",
                found,
                link.codec.name,
                path,
            )
            return
        self._stops[_EARLIER] = found
        link.emergency_stop()
        _log.warning(
            "the emergency stop by %s still holds, as before this server was started; look at the robot, then release "
            "it with `wirebond stop wirebond://%s --release --over`",
            found,
            Path(path or "").absolute(),
        )

    @property
    def name(self) -> str | None:
        """The name of the program that stopped the robot last; None: no stop is latched. Any thread."""
        return next(reversed(self._stops.copy().values()), None)

    def stop(self, client: Presser) -> None:
        """Stop the robot for this client.

        :raises UsageError: the protocol has no emergency stop.
        """
        self._link.emergency_stop()
        self._note(client.number, client.name)

    def release(self, client: Presser, over: bool | str) -> bool:
        """Release the stop. False: none was latched.

        :param over: True: also the stop of another program. A name: only if this program was the last other one to
            stop the robot.
        :raises StoppedByOtherError: another program stopped the robot, too, and this one does not overrule it.
        """
        if not self._stops:
            return False
        others = [name for number, name in self._stops.items() if number != client.number]
        if others and over is not True and over != others[-1]:
            raise StoppedByOtherError(
                f"{others[-1]} stopped the robot; look at the robot, then release the stop with "
                "release_stop(over=True)",
                others[-1],
            )
        self._link.release_stop()
        self._forget()
        left_out = self._reports.passes(time.monotonic()) if others else None
        if left_out is not None:
            _log.warning("%s released the emergency stop by %s%s", client.name, others[-1], and_more(left_out))
        return True

    def look(self) -> bool:
        """Follow what the owner of the link did without the server. True: it stopped the robot, or released the
        stop."""
        was = bool(self._stops)
        if not self._link.stopped:
            self._forget()
        elif not was:
            self._note(_EARLIER, OWNER)
        return was != bool(self._stops)

    def _note(self, number: int, name: str) -> None:
        self._stops.pop(number, None)
        self._stops[number] = name
        self._file.write(name)

    def _forget(self) -> None:
        if self._stops:
            self._stops.clear()
            self._file.remove()
