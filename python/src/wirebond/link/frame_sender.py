"""Gives finished frames to the engine, and converts its answers to exceptions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from wirebond.codec import Codec
from wirebond.errors import LinkDownError, QueueFullError, StoppedError, WirebondError
from wirebond.link.engine import DOWN, FULL, STOPPED, Engine
from wirebond.link.frame_maker import Frame, FrameMaker


class FrameSender:
    """Hands the frames of one link to its engine. Any thread.

    :param port: the link's port, for sentences.
    """

    def __init__(self, codec: Codec, port: str, engine: Engine, frames: FrameMaker) -> None:
        self._codec = codec
        self._port = port
        self._engine = engine
        self._frames = frames

    def leave(self, message: str, frame: Frame) -> None:
        """Queue one frame.

        :raises WirebondError: it was refused; see ``Link.send``.
        """
        answer = self._engine.send(*frame)
        if answer:
            raise self._refusal(message, answer)  # a name for it would hold this call, and so the link

    def sends_plain(self, name: str) -> bool:
        """Return whether frames of this message need no more than `leave`: they have no reply and no address."""
        return self._frames.message(name).reply < 0 and not self._frames.has_addresses

    def send_all(self, frames: list[tuple[int, bytes]]) -> list[WirebondError | None]:
        """Queue frames for which `sends_plain` holds, each with the index of its message, at a fraction of the cost.

        :returns: what refused each frame, or None.
        """
        answers = self._engine.send_all(frames)
        if not any(answers):
            return [None] * len(answers)
        names = [self._codec.model.messages[index].name for index, _ in frames]
        return [
            answer if isinstance(answer, WirebondError) else self._refusal(name, answer) if answer else None
            for name, answer in zip(names, answers, strict=True)
        ]

    def end_safely(self, name: str, header: Mapping[str, Any]) -> bool:
        """Send the message's safe value to the address of this header, before everything that waits, which is dropped.

        While the port is away it waits, and leaves first. False: the message has none, or the link is closed.
        """
        own = self._frames.message(name)
        address = self._frames.address_of(own, self._frames.with_own_address(header))
        return self._engine.end_safely(own.index, address)

    def raise_for(self, message: str, answer: int) -> None:
        """Raise the exception of an engine's answer, if it is one."""
        if answer:
            raise self._refusal(message, answer)

    def _refusal(self, message: str, answer: int) -> WirebondError:
        if answer == STOPPED:
            return StoppedError(message, (stop.message for stop in self._codec.model.emergency_stop))
        if answer == DOWN and self._engine.is_closed():
            return LinkDownError(f"the link to {self._port} is closed; {message} was not sent")
        if answer == DOWN:
            why = self._engine.why() or f"{self._port} was not connected a moment ago; try again"
            return LinkDownError(f"{message} was not sent: {why}")
        assert answer == FULL
        return QueueFullError(f"the send queue of {self._port} is full; {message} was not sent. Send less often")
