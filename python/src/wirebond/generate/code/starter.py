"""The one source file that a user writes beside the generated folder: a first version of it, with empty handlers."""

from __future__ import annotations

import re
from pathlib import Path

from wirebond.errors import UsageError
from wirebond.generate.code.c import link_in_c
from wirebond.generate.code.c_names import link_name
from wirebond.generate.code.cpp_field import comment_text
from wirebond.generate.code.cpp_names import struct_names
from wirebond.generate.code.folder import render
from wirebond.generate.code.names import identifier, namespace
from wirebond.protocol.model import End, Protocol

# The ports that there is a first source file for.
STARTER_PORTS = ("stm32_hal", "stm32_ll")
# Which DMA and which of its streams receive and send for a UART of an F4 (RM0090, 10.3.3); other families differ.
_STREAMS = {
    "USART1": (2, 2, 7), "USART2": (1, 5, 6), "USART3": (1, 1, 3), "UART4": (1, 2, 4), "UART5": (1, 0, 7),
    "USART6": (2, 1, 6), "UART7": (1, 3, 1), "UART8": (1, 6, 0),
}  # fmt: skip


def starter_path(out: Path, uart: str, language: str) -> Path:
    """Return the path of the file: in ``Core/Src`` next to the generated folder, as in CubeMX, or next to that folder.

    :raises UsageError: ``uart`` is not a UART's name.
    """
    folder = out.parent
    sources = folder / "Core" / "Src"
    return (sources if sources.is_dir() else folder) / f"{_prefix_and_handle(uart)[0]}_link{_ending(language)}"


def starter_text(protocol: Protocol, uart: str, language: str, port: str) -> str:
    """Return the file's text, for the UART that the vendor's headers call ``uart``, by one of ``STARTER_PORTS``.

    :raises UsageError: that is not a UART's name.
    """
    prefix, handle = _prefix_and_handle(uart)
    values: dict[str, object] = {
        "file": comment_text(Path(protocol.path).name or protocol.name),
        "uart": uart,
        "prefix": prefix,
        "handle": handle,
        **_wiring(uart),
    }
    return render(
        f"starter_{port}{_ending(language)}.j2", **values, **(_in_c if language == "c" else _in_cpp)(protocol)
    )


def _in_c(protocol: Protocol) -> dict[str, object]:
    link = link_in_c(protocol)
    own = _own(protocol)
    return {
        "header": f"{link_name(protocol.name)}.h",
        "link": link,
        "received": [m for m in link.received if m.name in own],
        "scheduled": [m for m in link.scheduled if m.name in own],
    }


def _in_cpp(protocol: Protocol) -> dict[str, object]:
    space, structs = namespace(protocol.name), struct_names(protocol)
    mine = [message for message in protocol.messages if message.name in _own(protocol)]
    here = [deadline for deadline in protocol.deadlines if deadline.at in (End.MCU, End.BOTH)]
    return {
        "header": f"{protocol.name}_link.hpp",
        "namespace": space,
        "received": [f"{space}::{structs[m.name]}" for m in mine if m.sent_by(End.HOST)],
        "scheduled": [
            (f"{space}::{structs[m.name]}", f"{m.every:g}") for m in mine if m.sent_by(End.MCU) and m.every is not None
        ],
        "actions": list(dict.fromkeys(identifier(deadline.then) for deadline in here)),
    }


def _wiring(uart: str) -> dict[str, object]:
    """Return the connections of a UART for a port without the HAL: those of an F4, or the first channels of a G4."""
    dma, receive, transmit = _STREAMS.get(uart, (1, 1, 2))
    carrier = f"DMA{dma}_{'Stream' if uart in _STREAMS else 'Channel'}"
    names = f"{uart}, DMA{dma}, {carrier}{receive}, {receive}, {carrier}{transmit}, {transmit}, {uart}_IRQn"
    return {"wiring": names, "receive": f"{carrier}{receive}"}


def _own(protocol: Protocol) -> set[str]:
    """Return the messages that are not a service's: those the link serves by itself."""
    mapped = {name for service in protocol.services for _, name in service.messages}
    return {message.name for message in protocol.messages} - mapped


def _ending(language: str) -> str:
    return ".c" if language == "c" else ".cpp"


def _prefix_and_handle(uart: str) -> tuple[str, str]:
    """Return for ``USART3`` the prefix of the file's functions, ``usart3``, and CubeMX's handle, ``huart3``."""
    match = re.fullmatch(r"(LP)?US?ART([0-9]+)", uart)
    if match is None:
        raise UsageError(
            f"--uart is '{uart}'; expected a UART as the vendor's headers call it, such as USART3 or UART4"
        )
    return uart.lower(), f"h{'lp' if match[1] else ''}uart{match[2]}"
