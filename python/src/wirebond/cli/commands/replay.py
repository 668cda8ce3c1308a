"""``wirebond replay``: a recording again, on a pty or into a firmware under virtual time."""

from __future__ import annotations

import errno
import os
import select
import sys
import time
from contextlib import suppress
from pathlib import Path

from wirebond.cli.commands.recordings import progress_bar, read
from wirebond.cli.output import console, errors, plain, warn
from wirebond.cli.signals import ended_by_signals
from wirebond.errors import UsageError
from wirebond.link.devices.port_name import replay_number
from wirebond.link.tap import Chunk
from wirebond.protocol.model import End
from wirebond.recording.into_firmware import replay_into_firmware
from wirebond.recording.recording import Recording
from wirebond.recording.replay import Pace, Section
from wirebond.sim.pty_port import PtyPort, symlinked

_WAIT = 0.1  # seconds between two attempts to write to a full pty
_LOOK = 0.01  # seconds between two checks how much a program has read
_PATIENCE = 200  # checks of a program that does not read; not a time, which a pause of the machine would use up


def section_of(speed: str, start: str | None, stop: str | None, loop: bool) -> Section:
    """Return the section that the command's options select."""
    found = {}
    for name, option, text in (("speed", "--speed", speed), ("from", "--from", start), ("to", "--to", stop)):
        try:
            found[name] = None if text is None else replay_number(name, text)
        except ValueError:
            wanted = "a number, or max" if name == "speed" else "seconds, such as 12.5s"
            raise UsageError(f"{option} {text}: expected {wanted}") from None
    return Section(found["speed"] or 0.0, found["from"] or 0.0, found["to"], loop)


class HangUpError(Exception):
    """The program closed its side of the pty."""


def replay_to_pty(path: Path, protocol: Path | None, section: Section, sender: str | None, link: Path | None) -> int:
    """Write to a pty what the recorded link read; bytes written to the pty are read and dropped."""
    recording = _read(path, protocol)
    direction = "received" if sender is None else recording.direction_of(sender)
    port = PtyPort()
    with symlinked(port.path, link) as name:
        console.print(name, soft_wrap=True)
        errors.print(
            f"replay of {plain(str(path))}, {section.length(recording):.3f} s; it begins when a program opens the pty",
            style="dim",
        )
        sent = 0
        with ended_by_signals(), suppress(KeyboardInterrupt, HangUpError):
            port.wait_for_program()
            pace = Pace(section)
            for chunk in section.rounds(recording, direction):
                pace.wait(chunk.t)
                _write(port, chunk)
                sent += len(chunk.bytes)
            _drain(port)
    port.close()
    errors.print(f"replayed {sent} bytes")
    return 0


def _write(port: PtyPort, chunk: Chunk) -> None:
    """Write all bytes: a slow reader makes the replay wait."""
    data = chunk.bytes
    while data:
        readable, writable, _ = select.select([port], [port], [], _WAIT)
        try:
            if readable:
                os.read(port.fileno(), 4096)
            if writable:
                data = data[os.write(port.fileno(), data) :]
        except BlockingIOError:
            continue
        except OSError as error:
            if error.errno != errno.EIO:
                raise
            raise HangUpError from None


def _drain(port: PtyPort) -> None:
    """Wait until the program has read everything, closes the pty, or stops reading: the line goes away with this
    process."""
    if sys.platform == "win32":
        return  # it has no ptys
    hung_up = select.poll()
    hung_up.register(port, 0)
    before, patience = None, _PATIENCE
    while patience > 0 and (left := port.unread()) != 0 and not hung_up.poll(0):
        patience = patience - 1 if left is None or left == before else _PATIENCE
        before = left
        time.sleep(_LOOK)


def replay_to_program(path: Path, protocol: Path | None, section: Section, program: Path, out: Path | None) -> int:
    """Replay into a firmware, and report whether it sent the recorded bytes."""
    recording = _read(path, protocol)
    if not os.access(program, os.X_OK) or program.is_dir():
        reason = "is not a program that may be run" if program.exists() else "is not there"
        raise UsageError(f"{program} {reason}; give a firmware that was built for this computer with the lockstep port")
    try:
        with progress_bar(f"replaying into {plain(program.name)}") as progress:
            rerun = replay_into_firmware(recording, program, out, section, progress=progress)
    except OSError as error:
        if error.errno != errno.ENOEXEC:
            raise
        raise UsageError(f"{program} cannot be run here; build it for this computer") from None
    decoder = recording.codec.decoder(End.MCU)
    messages = len(decoder.feed(rerun.sent)) + len(decoder.finish())
    errors.print(f"{plain(program.name)} sent {len(rerun.sent)} bytes, {messages} messages")
    at = rerun.differs_at
    if at is None:
        errors.print("they are the bytes that were recorded")
    else:
        errors.print(f"they differ from the {len(rerun.recorded)} recorded bytes from byte {at} on")
    for event in rerun.events:
        console.print(f"{event.t:.6f} s {plain(str(event.facts['text']))}", soft_wrap=True)
    return 0


def _read(path: Path, protocol: Path | None) -> Recording:
    recording = read(path, protocol)
    for problem in recording.problems:
        warn(problem)
    return recording
