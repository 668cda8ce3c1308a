"""Why the link refuses something, in words for a user of ROS: topics, and no calls of Python."""

from __future__ import annotations

from typing import TYPE_CHECKING

from wirebond.errors import LinkDownError, NotInControlError, QueueFullError, StoppedError

if TYPE_CHECKING:
    from wirebond.link import Link


class RosWords:
    """Makes the sentences. Any thread."""

    def __init__(self, link: Link, stop_topic: str, control_topic: str) -> None:
        """Both are whole names; empty: there is no such topic."""
        self._link = link
        self._stop_topic = stop_topic
        self._control_topic = control_topic

    def why(self, error: Exception, message: str = "") -> str:
        """Return the reason, for a sentence that already says that ``message`` was not sent."""
        if isinstance(error, StoppedError):
            end = f"false comes on {self._stop_topic}" if self._stop_topic else "the program that stopped releases it"
            return f"an emergency stop holds {', '.join(error.stopped)} until {end}"
        if isinstance(error, NotInControlError):
            return self._not_in_control()
        if isinstance(error, QueueFullError):
            return f"the line to {self._link.device} does not keep up; publish less often"
        return str(error).removeprefix(f"{message} was not sent: ")

    def _not_in_control(self) -> str:
        try:
            control = self._link.control
        except LinkDownError as error:
            return str(error)
        holder = control.holder
        command = f"ros2 topic pub --once {self._control_topic} std_msgs/msg/Empty"
        if holder is None and control.released_by is not None:
            return (
                f"{control.released_by} released the emergency stop, and no program has been in control since; look at "
                f"the robot, then take control: {command}"
            )
        if holder is None:
            return f"this node has lost control of the robot, and no program has it; to take it: {command}"
        return f"{holder} is in control of the robot; end its control there, then take it: {command}"
