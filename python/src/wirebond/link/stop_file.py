"""An emergency stop that outlives the program that holds it: who stopped the robot, in a file for the next one."""

from __future__ import annotations

import json
import logging
import os
import re
import stat
import time
from pathlib import Path

from wirebond.errors import UsageError
from wirebond.link.attached.address import make_socket_folder
from wirebond.seldom import Seldom, and_more
from wirebond.system import NOT_A_LINK, WITHOUT_WAITING

_log = logging.getLogger("wirebond.server")  # which `wirebond serve` prints
_UNKNOWN = "a program that is not known any more"
_MOST = 4096  # bytes; `write` makes shorter ones


class StopFile:
    """Exists while the stop is latched. If the program that holds the stop ends or is killed, the file stays for the
    next one.

    :param path: of the file. None: the stop ends with the program that holds it.
    """

    def __init__(self, path: str | os.PathLike[str] | None) -> None:
        self._path = None if path is None else Path(path)
        self._written = ""
        self._reports = Seldom()

    def read(self) -> str | None:
        """Return the name of the program that stopped the robot, or None if no stop is latched. A file that cannot be
        read, or is not whole, counts as a stop: releasing it is one command, and a robot that drives by mistake is
        worse."""
        if self._path is None:
            return None
        try:
            found = json.loads(_text_of(self._path))["stopped_by"]
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            return _UNKNOWN
        return found if isinstance(found, str) and found.isprintable() and len(found) < 200 else _UNKNOWN

    def write(self, name: str) -> None:
        """Keep the stop. The file exists before anything is written to it, so it counts as a stop at every moment: if
        this program is killed in between, and also on a full disk, which has no space for the name. Another failure is
        logged: the stop itself holds nevertheless."""
        if self._path is None or name == self._written:
            return
        try:
            descriptor = os.open(self._path, os.O_WRONLY | os.O_CREAT | NOT_A_LINK | WITHOUT_WAITING, 0o600)
        except OSError as error:
            self._say(
                f"the emergency stop holds, but it would be forgotten if this program were restarted: {self._path} "
                f"cannot be written ({error.strerror or error})"
            )
            return
        try:
            os.ftruncate(descriptor, 0)
            os.write(descriptor, json.dumps({"stopped_by": name}).encode())
            self._written = name
        except OSError as error:
            self._say(
                f"the emergency stop is kept in {self._path}, but without the name of the program that stopped the "
                f"robot ({error.strerror or error})"
            )
        finally:
            os.close(descriptor)

    def remove(self) -> None:
        """Forget the stop: it is released."""
        self._written = ""
        if self._path is None:
            return
        try:
            self._path.unlink(missing_ok=True)
        except OSError as error:
            self._say(
                f"the emergency stop is released, but it would hold again after a restart: {self._path} cannot be "
                f"removed ({error.strerror or error})"
            )

    def _say(self, text: str) -> None:
        """Write the state; a program may stop and release without pause."""
        left_out = self._reports.passes(time.monotonic())
        if left_out is not None:
            _log.warning("%s%s", text, and_more(left_out))


def stop_file_of(program: str, port: str) -> StopFile:
    """Return the file of a program that has a port of its own and is started again under the same name, in the folder
    of this user's sockets.

    :param program: its name, such as that of a node of ROS.
    :param port: a name of the port.
    """
    name = re.sub(r"[^A-Za-z0-9_.-]", "-", f"{program} {port}")
    try:
        return StopFile(make_socket_folder() / f"{name[-200:]}.stop")
    except UsageError as error:
        _log.warning("an emergency stop would be forgotten if this program were restarted: %s", error)
        return StopFile(None)


def _text_of(path: Path) -> str:
    """Return the text of the file. Never waits: a server must start, whatever is at that path.

    :raises OSError: it is not there, or cannot be read.
    :raises ValueError: it is not a file that ``write`` made.
    """
    descriptor = os.open(path, os.O_RDONLY | NOT_A_LINK | WITHOUT_WAITING)
    with os.fdopen(descriptor, "rb") as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise ValueError("no regular file")
        return file.read(_MOST).decode()
