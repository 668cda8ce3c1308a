"""``wirebond stop``: the emergency stop of a running server, and its release."""

from __future__ import annotations

from wirebond.cli.output import errors, plain
from wirebond.errors import StoppedByOtherError, UsageError
from wirebond.link import open_link
from wirebond.link.attached.address import SCHEME


def stop_robot(server: str, release: bool, over: bool) -> int:
    """Exit code 1: the stop still holds, because another program stopped the robot."""
    if not server.startswith(SCHEME):
        raise UsageError(
            f"{server!r:.80} is not a server; give wirebond://NAME. A stop is latched in the server that owns the "
            "port; for a port without one, send the message itself with `wirebond send`"
        )
    if over and not release:
        raise UsageError("--over belongs to --release")
    with open_link(server) as link:
        if not release:
            link.emergency_stop()
            errors.print(f"{plain(link.codec.name)} is stopped, until `wirebond stop {plain(server)} --release --over`")
            return 0
        if not link.stopped:
            errors.print("no emergency stop is latched")
            return 0
        try:
            link.release_stop(over=over)
        except StoppedByOtherError as error:
            errors.print(
                f"the stop still holds: {plain(error.by)} stopped the robot. Look at the robot, then add --over"
            )
            return 1
        errors.print("the emergency stop is released; no program is in control")
        return 0
