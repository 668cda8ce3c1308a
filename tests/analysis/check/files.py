"""Shared by the lint's tests: the project's protocol files, and small protocols made from a frame and messages."""

from __future__ import annotations

from pathlib import Path

from tests.shared import loaded

from wirebond.analysis.check import Finding
from wirebond.codec import Codec
from wirebond.protocol import loads

PROTOCOLS = Path(__file__).parents[3] / "protocols"
DEFAULT_FRAME = "[magic: 0xA5, length: u8, id: u8, payload: by_length, check: crc-16/mcrf4xx]"
DEFAULT_MESSAGES = "{state: {id: 1, sender: mcu, fields: {x: {type: i16}}}}"


def shipped(name: str) -> Codec:
    return loaded(PROTOCOLS / f"{name}.yaml")


def made(
    frame: str = DEFAULT_FRAME,
    messages: str = DEFAULT_MESSAGES,
    rest: str = "",
    baud: int = 115200,
    max_run: str = "1 ms",
    echo: bool = False,
) -> Codec:
    link = f"{{baud: {baud}, max_run: {max_run}, echo: {str(echo).lower()}}}"
    return Codec(loads(f"wirebond: 1\nprotocol: made\nlink: {link}\nframe: {frame}\nmessages: {messages}\n{rest}\n"))


def rules(findings: list[Finding]) -> list[str]:
    return [finding.rule for finding in findings]
