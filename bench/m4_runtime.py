"""Measures the cost of a link on a Cortex-M: instructions of a send and of each interrupt, flash, RAM, stack, masked
interrupts.

Counted and measured on generated code; bench/README.md says how. The processor's share is computed from the counts.
"""

from __future__ import annotations

import random
import shutil
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.streams import random_values

import wirebond
from bench.collateral import PROTOCOL, SEED
from bench.cortex_m4 import M0, M4, Processor, Program, compile_program
from bench.figures import ROOT, Figure
from bench.m4_cost import FOLDER, MESSAGES, ROUNDS, samples
from bench.native import BUILD
from bench.stack_depth import stack_depth
from wirebond.generate.code import generate_cpp
from wirebond.generate.code.cpp_names import struct_names
from wirebond.generate.code.names import namespace
from wirebond.protocol import loads
from wirebond.protocol.model import End, Protocol

CODEC = wirebond.load(PROTOCOL)
LAYOUTS = {"field_msg": "BHHB8H8H???", "sentry_gimbal_msg": "BBf4f4f"}  # the structs' members, as `struct` has them
COMMAND = "make bench ONLY=m4_runtime"
PROTOCOLS = ("diffdrive", "pid_tuner", "enterprize", "native")
INTERRUPT = ("on_received", "on_transmitted", "on_pended", "on_error")
LINK = ("poll", *INTERRUPT)  # what every firmware calls
REPEATED = ("poll_times", "poll_frames", "on_received_times", "on_transmitted_times", "on_pended_times")
CLOCK_HZ = 170e6
SENT_A_SECOND = 4000  # seed 000's overload test: four senders at 1 kHz
DEBUG_GOALS = {  # of a minimal link at -O0 and -Og
    "m4_debug_flash_bytes": 40960.0,
    "m4_debug_send_stack_bytes": 768.0,
    "m4_debug_poll_stack_bytes": 1024.0,
    "m4_debug_interrupt_stack_bytes": 448.0,
    "m4_og_flash_bytes": 16384.0,
    "m4_og_send_stack_bytes": 448.0,
    "m4_og_poll_stack_bytes": 512.0,
    "m4_og_interrupt_stack_bytes": 256.0,
}
RECEIVED_A_SECOND = 8240  # the same, as its authors counted it
RUNS_A_SECOND = 1000  # a run is a millisecond of line


@dataclass(frozen=True)
class Sizes:
    """The sizes of the buffers: bytes to receive, bytes and frames to send."""

    receive: int
    send: int
    frames: int


ROVER = Sizes(256, 64, 4)  # as firmware/rover has them
CART = Sizes(256, 128, 4)  # as README.md has them
OTHERS = Sizes(256, 256, 4)
LARGE = Sizes(512, 16384, 512)  # so that every message of a count finds room


def measure() -> list[Figure]:
    return [
        *_instructions(),
        *measure_finish(),
        *measure_memory(),
        *measure_servo(),
        *measure_debug_builds(),
        *_masked(),
    ]


def _figure(key: str, value: float, unit: str, goal: float | None = None) -> Figure:
    return Figure(key, value, unit, goal, COMMAND)


def _difference(program: Program, function: str, rounds: tuple[int, int], *arguments: int) -> float:
    """Instructions of one round."""
    counts = []
    for times in rounds:
        assert program.call(function, times, *arguments) == 0, f"{function} does not do its work"
        counts.append(program.counts.total())
    return (counts[1] - counts[0]) / (rounds[1] - rounds[0])


# ---- instructions, at -O2


def measure_send() -> list[Figure]:
    """Measure the message with the most expensive send."""
    return _measure_send()[0]


def _measure_send() -> tuple[list[Figure], Program]:
    """And the program, with one message in its queue."""
    sends = []
    for name in MESSAGES:
        program, _ = runtime("enterprize", "-O2", LARGE, counting=True)
        sends.append(_send_cost(program, name))
    figures = [
        _figure("m4_send_instructions", max(cost for cost, _ in sends), "instructions", 400.0),
        _figure("m4_send_exclusive_stores", max(stores for _, stores in sends), "exclusive stores"),
    ]
    return figures, program


def _instructions() -> list[Figure]:
    sends, program = _measure_send()
    program.call("on_pended")  # the first run
    transmitted = _difference(program, "on_transmitted_times", (10, 40))
    received = _difference(program, "on_received_times", ROUNDS)
    pended = _difference(program, "on_pended_times", ROUNDS)
    idle = _difference(program, "poll_times", ROUNDS)
    frame = _receive_cost(program)
    sending = 100 * (SENT_A_SECOND * sends[0].value + RUNS_A_SECOND * transmitted) / CLOCK_HZ
    receiving = 100 * (RECEIVED_A_SECOND * frame + RUNS_A_SECOND * (received + idle)) / CLOCK_HZ
    return [
        *sends,
        _figure("m4_on_transmitted_instructions", transmitted, "instructions"),
        _figure("m4_on_received_instructions", received, "instructions"),
        _figure("m4_on_pended_instructions", pended, "instructions"),
        _figure("m4_poll_instructions", idle, "instructions"),
        _figure("m4_receive_instructions", frame, "instructions"),
        _figure("m4_sending_share", sending, "% (computed)"),
        _figure("m4_receiving_share", receiving, "% (computed)"),
    ]


def measure_finish() -> list[Figure]:
    """Measure the extra cost in the UART's interrupt of a frame that gets its sequence number there: number and
    checks."""
    text = (ROOT / "protocols" / "enterprize.yaml").read_text(encoding="utf-8")
    numbered = text.replace("protocol: enterprize", "protocol: numbered")
    numbered = numbered.replace("  - payload: by_length\n", "  - sequence: u8\n  - payload: by_length\n")
    plain, with_numbers = (_frame_cost(loads(t)) for t in (text, numbered))
    return [_figure("m4_finish_instructions", with_numbers - plain, "instructions")]


def _frame_cost(model: Protocol) -> float:
    """Instructions of the UART's interrupt for each frame of the largest message that it hands to DMA."""
    program, _ = runtime(model, "-O2", LARGE, counting=True)
    message = max((m for m in model.messages if m.sent_by(End.MCU)), key=lambda m: m.max_payload)
    frames_of_a_run = max(1, model.link.max_run_bytes // model.max_wire_bytes(message.max_payload))
    program.call("poll")
    assert program.call(f"send_{message.name}", 60 * frames_of_a_run) == 0, f"{message.name} is refused"
    program.call("on_pended")  # the first run
    return _difference(program, "on_transmitted_times", (5, 20)) / frames_of_a_run


def _send_cost(program: Program, name: str) -> tuple[float, float]:
    """Instructions and exclusive stores of one send. Fails where what lies in the queue is not the message's frame."""
    (_, values), *_ = samples(name)
    program.call("poll")
    program.write(f"{name}_value", struct.pack(f"@{LAYOUTS[name]}", *_flat(values)))
    frame = CODEC.encode(name, values)
    assert program.call(f"send_{name}", sum(ROUNDS)) == 0, f"{name} is refused"
    queued = program.read("buffers", LARGE.receive + len(frame) * sum(ROUNDS))[LARGE.receive :]
    assert queued == frame * sum(ROUNDS), f"what lies in the queue is not {name}"
    program.call("on_pended")
    program.call("on_transmitted_times", sum(ROUNDS))  # all leave: from here on no send makes a new high-water mark
    cost = _difference(program, f"send_{name}", ROUNDS)
    program.call(f"send_{name}", 1)
    return cost, float(program.exclusive_stores())


def _receive_cost(program: Program) -> float:
    """Instructions of a poll that finds one whole frame."""
    message = CODEC.model.message("sentry_gimbal_cmd")
    frame = CODEC.encode(message.name, random_values(message, random.Random(SEED)))
    program.write("buffers", frame * (LARGE.receive // len(frame)))
    return _difference(program, "poll_frames", (3, 10), len(frame))


def _flat(values: dict[str, Any]) -> Iterator[Any]:
    for value in values.values():
        yield from value if isinstance(value, list | tuple) else (value,)


# ---- memory, at -Os


def measure_memory(protocols: Sequence[str] = PROTOCOLS) -> list[Figure]:
    """AssertionError where the stack of one of a link's functions has no bound."""
    figures = []
    for name in protocols:
        program, graph = runtime(name, "-Os", ROVER if name == "diffdrive" else OTHERS)
        flash, ram = float(program.flash_bytes), float(program.sizes["runtime"])
        if name == "diffdrive":
            figures += [
                _figure("m4_flash_bytes", flash, "bytes", 6656.0),
                _figure("m4_ram_bytes", ram, "bytes", 448.0),
                *_stacks("m4", _model(name), graph),
            ]
        else:
            figures += [
                _figure(f"m4_flash_bytes_{name}", flash, "bytes"),
                _figure(f"m4_ram_bytes_{name}", ram, "bytes"),
            ]
    return figures


def measure_servo() -> list[Figure]:
    """Measure firmware/servo, whose frames have an address. AssertionError if it answers a request for another servo,
    or does not answer the one for its own number, 3."""
    folder = BUILD / "servo"
    shutil.rmtree(folder, ignore_errors=True)
    generate_cpp(_model("servo_bus"), folder)
    includes = [folder, ROOT / "firmware" / "servo"]
    more = ["-ffunction-sections", "-fdata-sections", "-Wl,--gc-sections"]
    program = Program(compile_program(FOLDER / "servo.cpp", "-Os", includes, keep=LINK, more=more))
    codec = wirebond.load(ROOT / "protocols" / "servo_bus.yaml")
    program.call("poll")
    came, answers = b"", []
    for number in (2, 3, 0xFE):  # another one, its own, all of them
        came += codec.encode("read", header={"servo": number})
        program.write("buffers", came)
        program.write("received_bytes", struct.pack("<I", len(came)))
        program.call("on_received")
        program.call("poll")
        program.call("on_pended")
        program.call("on_transmitted")
        answers.append(struct.unpack("<I", program.read("runs", 4))[0])
    assert answers == [0, 1, 1], f"after each request it had answered {answers} times"
    return [
        _figure("m4_servo_flash_bytes", float(program.flash_bytes), "bytes"),
        _figure("m4_servo_ram_bytes", float(program.sizes["firmware"]), "bytes"),
    ]


def measure_debug_builds() -> list[Figure]:
    """Measure a minimal link, as development environments build it by default: -O0 (`debug`) and -Og."""
    model = wirebond.load(FOLDER / "cart.yaml").model
    figures = []
    for level, optimise in (("debug", "-O0"), ("og", "-Og")):
        program, graph = runtime(model, optimise, CART, fills=True)
        flash = f"m4_{level}_flash_bytes"
        figures.append(_figure(flash, float(program.flash_bytes), "bytes", DEBUG_GOALS[flash]))
        figures += _stacks(f"m4_{level}", model, graph)
    return figures


def _stacks(prefix: str, model: Protocol, graph: Path) -> list[Figure]:
    sends = [f"send_{m.name}" for m in model.messages if m.sent_by(End.MCU)]
    entries: dict[str, Sequence[str]] = {"send": sends, "poll": ["poll"], "interrupt": INTERRUPT}
    figures = []
    for name, functions in entries.items():
        deepest = max(stack_depth(graph, function) for function in functions)
        key = f"{prefix}_{name}_stack_bytes"
        figures.append(_figure(key, deepest, "bytes", DEBUG_GOALS.get(key)))
    return figures


# ---- interrupts masked, on a processor without exclusive access


def _masked() -> list[Figure]:
    program, _ = runtime("diffdrive", "-Os", ROVER, M0)
    program.call("poll")
    for _ in range(3):  # full at once, and refused
        for _ in range(6):
            program.call("send_odometry", 1)
        for _ in range(6):
            program.call("on_transmitted")
            program.call("on_pended")
    assert program.longest_masked > 0, "nothing is masked: this processor has exclusive access"
    return [_figure("m0_masked_instructions", program.longest_masked, "instructions")]


# ---- the program


def runtime(
    protocol: str | Protocol,
    optimise: str,
    sizes: Sizes,
    processor: Processor = M4,
    *,
    counting: bool = False,
    fills: bool = False,
) -> tuple[Program, Path]:
    """The program of bench/firmware/runtime.cpp for a protocol, and its call graph. ``counting``: with the functions
    that repeat. ``fills``: the handler has a `fill` for each message that the MCU sends by itself."""
    model = _model(protocol) if isinstance(protocol, str) else protocol
    name = f"runtime_{model.name}_{processor.name}_{sizes.send}"
    folder = BUILD / name
    shutil.rmtree(folder, ignore_errors=True)
    generate_cpp(model, folder)
    (folder / "handler.hpp").write_text(_handler(model, fills), encoding="utf-8")
    (folder / "sends.hpp").write_text(_sends(model), encoding="utf-8")
    definitions = {"RECEIVE_BYTES": sizes.receive, "SEND_BYTES": sizes.send, "SEND_FRAMES": sizes.frames}
    more = [*(f"-D{key}={value}U" for key, value in definitions.items()), "-ffunction-sections", "-Wl,--gc-sections"]
    source = FOLDER / "runtime.cpp"
    keep = [*LINK, *(f"send_{m.name}" for m in model.messages if m.sent_by(End.MCU)), *(REPEATED if counting else ())]
    elf = compile_program(source, optimise, [folder], keep=keep, processor=processor, more=more, name=name)
    more += ["-fcallgraph-info=su", "-fno-ipa-icf", "-c"]  # functions that are alike are not told of twice else
    parts = compile_program(source, optimise, [folder], keep=keep, processor=processor, more=more, name=f"{name}_")
    return Program(elf, processor), parts.with_suffix(".ci")


def _model(protocol: str) -> Protocol:
    return wirebond.load(ROOT / "protocols" / f"{protocol}.yaml").model


def _handler(model: Protocol, fills: bool) -> str:
    """A handler that has every message and every deadline's function; an empty one each, in another file as it were."""
    actions = dict.fromkeys(d.then for d in model.deadlines if d.at == End.MCU)
    structs = struct_names(model)
    return "\n".join(
        [
            f'#include "{model.name}_link.hpp"',
            f"namespace protocol = {namespace(model.name)};",
            "struct Handler {",
            "  template <class Message> __attribute__((noinline)) void on(const Message& message) {",
            '    asm volatile("" : : "r"(&message) : "memory");',
            "    ++calls;",
            "  }",
            *(
                f"  bool fill(protocol::{structs[m.name]}&) {{ return true; }}"
                for m in model.messages
                if fills and m.sent_by(End.MCU) and m.every is not None
            ),
            "  std::uint32_t calls = 0;",
            *(f'  void {action}() {{ asm volatile(""); }}' for action in actions),
            "};",
            "",
        ]
    )


def _sends(model: Protocol) -> str:
    """A value of each message that the MCU sends, and a function that sends it a number of times. 0: all accepted."""
    structs = struct_names(model)
    names = [m.name for m in model.messages if m.sent_by(End.MCU)]
    return "\n".join(
        [
            'extern "C" {',
            *(f"protocol::{structs[name]} {name}_value;" for name in names),
            *(
                f"std::uint32_t send_{name}(std::uint32_t times) {{ return send({name}_value, times); }}"
                for name in names
            ),
            "}",
            "",
        ]
    )
