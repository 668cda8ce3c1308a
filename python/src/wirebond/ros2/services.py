"""Services of ROS: a call sends a message or ends a deadline, and the response says what came of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from wirebond.errors import WirebondError
from wirebond.ros2.commands import RefusedError
from wirebond.ros2.json_text import to_json
from wirebond.ros2.mapping.model import ServiceMapping
from wirebond.ros2.node import Answer

if TYPE_CHECKING:
    from wirebond.codec import Message
    from wirebond.link import Link
    from wirebond.ros2.commands import Commands

_NO_STAMP = {"sec": 0, "nanosec": 0}


class Services:
    """Makes what answers each service. Those functions may be called by any thread, and wait for the MCU."""

    def __init__(self, link: Link, commands: Commands, pass_on: Callable[[list[Message]], None]) -> None:
        """``pass_on``: takes the replies, which ``receive`` of the link does not give."""
        self._link = link
        self._commands = commands
        self._pass_on = pass_on

    def answer(self, mapping: ServiceMapping) -> Answer:
        """Return the function that makes the response of this service."""
        act = self._recover if mapping.recover else self._ask if mapping.has_reply else self._tell

        def answer(request: dict[str, Any]) -> dict[str, Any]:
            try:
                return _fitting(mapping, act(mapping, request))
            except (RefusedError, WirebondError) as error:
                return _fitting(mapping, {"success": False, "message": str(error)})

        return answer

    def _tell(self, mapping: ServiceMapping, request: dict[str, Any]) -> dict[str, Any]:
        self._commands.tell(mapping.message, _values(mapping, request))
        return {"success": True, "message": f"{mapping.message} was sent; the protocol has no reply to it"}

    def _ask(self, mapping: ServiceMapping, request: dict[str, Any]) -> dict[str, Any]:
        reply = self._commands.ask(mapping.message, _values(mapping, request), mapping.timeout)
        self._pass_on([reply])
        given = {"success": True, "message": f"{reply.name}: {to_json(reply)}"}
        try:
            return given | ({} if mapping.answer is None else mapping.answer(reply.fields, _NO_STAMP))
        except LookupError:  # a number that the file's enum has no name for
            return given | {"success": False}

    def _recover(self, mapping: ServiceMapping, _request: dict[str, Any]) -> dict[str, Any]:
        if why := self._commands.why_old():
            raise RefusedError("old", why)
        has_struck = self._link.deadlines[mapping.recover]
        self._link.recover(mapping.recover)
        return {"success": True, "message": f"{mapping.recover} {'is over' if has_struck else 'had not struck'}"}


def _values(mapping: ServiceMapping, request: dict[str, Any]) -> dict[str, Any]:
    return {name: getter(request) for name, getter in mapping.values}


def _fitting(mapping: ServiceMapping, response: dict[str, Any]) -> dict[str, Any]:
    """Keep only the fields that the type has: std_srvs/Empty has none."""
    return {name: value for name, value in response.items() if mapping.type.response.field(name) is not None}
