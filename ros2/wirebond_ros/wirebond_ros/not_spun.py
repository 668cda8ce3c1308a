"""Entities of a node that its executor leaves alone, because a loop of this package takes what comes to them."""

from __future__ import annotations

from typing import Any

from rclpy.callback_groups import CallbackGroup


class NotSpun(CallbackGroup):
    """For entities of one class; others of the group, such as their events, the executor serves."""

    def __init__(self, kind: type) -> None:
        super().__init__()
        self._kind = kind

    def can_execute(self, entity: Any) -> bool:
        return not isinstance(entity, self._kind)

    def beginning_execution(self, entity: Any) -> bool:  # noqa: ARG002 a method of rclpy
        return True

    def ending_execution(self, entity: Any) -> None:
        """Nothing to give back."""
