"""Byte orders as Python names them."""

from __future__ import annotations

from typing import Literal

from wirebond.protocol.model import ByteOrder


def order_of(order: ByteOrder) -> Literal["little", "big"]:
    return "little" if order == ByteOrder.LITTLE else "big"
