"""Entities of a node that its executor leaves alone, because a loop of this package takes what comes to them."""

from __future__ import annotations

from typing import Any

from rclpy.callback_groups import CallbackGroup


class NotSpun(CallbackGroup):
    """For subscriptions, services, and the events of publishers and subscriptions."""

    def can_execute(self, entity: Any) -> bool:  # noqa: ARG002 a method of rclpy, as the next one
        return False

    def beginning_execution(self, entity: Any) -> bool:  # noqa: ARG002
        return False

    def ending_execution(self, entity: Any) -> None:
        """Do nothing: there is nothing to give back."""
