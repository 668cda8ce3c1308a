"""``wirebond new``: copies a template or a public format to the user's own file, and shows the next commands."""

from __future__ import annotations

import shlex
from pathlib import Path

from wirebond.cli.output import console, plain
from wirebond.generate.new import TEMPLATES, parts_of, write_template


def write_first_file(path: Path, has: str | None, template: str, port: str | None) -> None:
    write_template(path, template, None if has is None else parts_of(has))
    file = shlex.quote(str(path))
    robot = shlex.quote(port or "/dev/ttyUSB0")
    if template in TEMPLATES:
        console.print(plain(f"{path}: put your messages in. Next:"), soft_wrap=True)
        steps = {
            f"wirebond check {file}": "its mistakes, after each change",
            f"wirebond serve {file} sim: --web": "a simulated MCU in your browser; drive it, and its values move",
            f"wirebond gen {file} --port stm32_hal --out generated": "the MCU's end; --help names the other ports",
        }
        own = "the robot itself"
    else:
        console.print(plain(f"{path}: a copy of Wirebond's file for {template}. Next:"), soft_wrap=True)
        steps = {}
        own = "the device itself"
    steps[f"wirebond serve {file} {robot} --web"] = own + ("" if port else ", at its own port")
    width = max(map(len, steps))
    for step, why in steps.items():
        console.print(plain(f"  {step:{width}}  # {why}"), soft_wrap=True)
