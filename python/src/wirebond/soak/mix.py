"""What both ends of a soak offer, and the C++ header that tells its program."""

from __future__ import annotations

from dataclasses import dataclass

from wirebond.codec import Codec
from wirebond.errors import UsageError
from wirebond.gen.cpp import struct_names
from wirebond.gen.names import namespace
from wirebond.protocol.model import End, Message, Queue
from wirebond.protocol.plan import plan_for
from wirebond.sim.virtual_mcu import VirtualMcu

SAMPLES = 64  # of each message: frames in flight that have the same payload could not be told apart
SEED_PERIOD = 0.001  # seconds: each topic and each task of the overload experiment runs at 1 kHz
_SAMPLE_STEP = 0.37  # seconds of the made-up values between two samples

# The overload experiment of the ENTERPRIZE team: five topics of two messages each, against four tasks.
_SEED_TASKS = {"enterprize": ("sentry_gimbal_msg",) * 4}
_SEED_TIMES = 2


@dataclass(frozen=True)
class Turn:
    """A topic of the host, or a task of the MCU: what it sends each time that it runs."""

    message: str
    times: int


@dataclass(frozen=True)
class Mix:
    """``host`` and ``mcu`` run at one period each."""

    host: tuple[Turn, ...]
    mcu: tuple[Turn, ...]
    is_seed: bool  # the experiment that `--load seed` means

    def bytes_per_round(self, codec: Codec, end: End) -> float:
        """Of all topics or tasks together, each once; of the samples' mean size."""
        turns = self.host if end == End.HOST else self.mcu
        sizes = {turn.message: [len(frame) for frame in samples(codec, turn.message, end)] for turn in turns}
        return sum(turn.times * sum(sizes[turn.message]) / SAMPLES for turn in turns)


def mix_of(codec: Codec) -> Mix:
    """The experiment's own mix for its protocol. For others: every message of an end once, services left out.

    :raises UsageError: the protocol has what a soak cannot account for.
    """
    _refuse_what_cannot_be_told(codec)
    model = codec.model
    services = {name for service in model.services for name in dict(service.messages).values()}
    ends = {}
    for end in (End.HOST, End.MCU):
        names = [m.name for m in model.messages if m.sent_by(end) and m.name not in services]
        if not names:
            raise UsageError(f"{model.name}: the {end} sends no message, so there is nothing to soak in its direction")
        ends[end] = names
    tasks = _SEED_TASKS.get(model.name)
    is_seed = tasks is not None and all(name in ends[End.MCU] for name in tasks)
    times = _SEED_TIMES if is_seed else 1
    return Mix(
        tuple(Turn(name, times) for name in ends[End.HOST]),
        tuple(Turn(name, 1) for name in (tasks if is_seed and tasks else ends[End.MCU])),
        is_seed,
    )


def _refuse_what_cannot_be_told(codec: Codec) -> None:
    model = codec.model
    ids = [(m.id, end) for end in (End.HOST, End.MCU) for m in model.messages if m.sent_by(end)]
    reasons = {
        "silence ends its frames": model.format.ends_by_silence,
        "its frames have a sequence number": plan_for(model, End.HOST).sequence is not None
        or plan_for(model, End.MCU).sequence is not None,
        "its frames have an address": any(plan_for(model, end).address is not None for end in (End.HOST, End.MCU)),
        "several of its messages share an id": len(ids) != len(set(ids)),
        "its messages are told by `match`": any(m.match for m in model.messages),
        "it has messages of `queue: latest` or `queue: urgent`": any(m.queue != Queue.NORMAL for m in model.messages),
        "it maps the hello service": model.service("hello") is not None,
    }
    for reason, holds in reasons.items():
        if holds:
            raise UsageError(f"{model.name}: a soak cannot account for every frame of this protocol: {reason}")


def samples(codec: Codec, name: str, end: End) -> list[bytes]:
    """Frames of a message with different plausible values."""
    message = codec.model.message(name)
    made_up = VirtualMcu(codec, 0.0)._made_up
    return [codec.encode(name, made_up(message, i * _SAMPLE_STEP), sender=end) for i in range(SAMPLES)]


def header(codec: Codec, mix: Mix) -> str:
    """``mix.hpp``: what the soak's C++ program is compiled with, beside the generated headers."""
    model = codec.model
    structs = struct_names(model)
    host = list(dict.fromkeys(turn.message for turn in mix.host))
    mcu = list(dict.fromkeys(turn.message for turn in mix.mcu))
    actions = dict.fromkeys(d.then for d in model.deadlines if d.at == End.MCU)
    from_mcu = sorted((m for m in model.messages if m.sent_by(End.MCU)), key=lambda m: m.id)
    lines = [
        f"// Made by `wirebond soak` from {model.name}: what both ends offer.",
        "#pragma once",
        "",
        "#include <array>",
        "#include <cstddef>",
        "#include <cstdint>",
        "#include <vector>",
        "",
        '#include "ledger.hpp"',
        f'#include "{model.name}_link.hpp"',
        '#include "wirebond/host/runtime_source.hpp"',
        "",
        "namespace mix {",
        "",
        f"namespace protocol = ::{namespace(model.name)};",
        f"inline constexpr std::size_t samples = {SAMPLES};",
        f"inline constexpr std::size_t host_messages = {len(host)};",
        f"inline constexpr std::size_t mcu_messages = {len(mcu)};",
        "inline constexpr std::size_t longest_run_bytes = "
        "protocol::AtMcu::max_run_bytes > protocol::AtMcu::max_sent_bytes ? protocol::AtMcu::max_run_bytes "
        ": protocol::AtMcu::max_sent_bytes;",
        "struct Turn {",
        "  std::uint16_t message;",
        "  unsigned times;",
        "};",
        _turns("topics", mix.host, host),
        _turns("tasks", mix.mcu, mcu),
        "",
        "struct Actions {",
        *(f"  void {action}() {{}}" for action in actions),
        "};",
        "",
        *_frames(codec, "host", host, End.HOST),
        *_frames(codec, "mcu", mcu, End.MCU),
        "",
        "inline std::vector<wirebond::MessageRow> rows_from_mcu() {",
        "  return {",
        *(_row(m) for m in from_mcu),
        "  };",
        "}",
        _places("host_message", [codec._index_of(name) for name in host]),
        _places("mcu_message", [codec._index_of(name) for name in mcu]),
        "inline std::int16_t host_index(std::uint16_t message) {",
        f"  constexpr std::int16_t indices[] = {{{', '.join(str(codec._index_of(name)) for name in host)}}};",
        "  return indices[message];",
        "}",
        "",
        *(f"inline std::array<protocol::{structs[name]}, samples> values_{i};" for i, name in enumerate(mcu)),
        "",
        "/// Before all else. False: a sample is none of its message.",
        "inline bool prepare() {",
        "  bool holds = true;",
        "  for (std::uint16_t i = 0; i < samples; ++i) {",
        *(
            f"    holds = decode(from_mcu({i}, i).payload, from_mcu({i}, i).payload_size, values_{i}[i]) && holds;"
            for i in range(len(mcu))
        ),
        "  }",
        "  return holds;",
        "}",
        "",
        "template <class Link>",
        "wirebond::Status send(Link& link, std::uint16_t message, std::uint16_t sample) {",
        "  switch (message) {",
        *(f"    case {i}: return link.send(values_{i}[sample]);" for i in range(1, len(mcu))),
        "    default: return link.send(values_0[sample]);",
        "  }",
        "}",
        "",
        "}  // namespace mix",
        "",
    ]
    return "\n".join(lines)


def _row(message: Message) -> str:
    return f"      {{{message.id}u, protocol::FromMcu{{}}.message({message.id}u)}},"


def _turns(name: str, turns: tuple[Turn, ...], messages: list[str]) -> str:
    rows = ", ".join(f"Turn{{{messages.index(turn.message)}, {turn.times}}}" for turn in turns)
    return f"inline constexpr std::array<Turn, {len(turns)}> {name}{{{rows}}};"


def _places(name: str, indices: list[int]) -> str:
    """From a message's index in the file to its place here; one that is not offered has none, and matches nothing."""
    cases = "".join(f" case {index}: return {place};" for place, index in enumerate(indices))
    return f"inline std::uint16_t {name}(std::int16_t index) {{ switch (index) {{{cases} default: return 0xFFFF; }} }}"


def _frames(codec: Codec, end: str, messages: list[str], sender: End) -> list[str]:
    decoder = codec.decoder(sender)
    rows = []
    lines = []
    for place, name in enumerate(messages):
        for number, frame in enumerate(samples(codec, name, sender)):
            (message,) = decoder.feed(frame)
            payload = message.payload
            array = f"{end}_{place}_{number}"
            lines.append(_bytes(array, frame))
            lines.append(_bytes(f"{array}_payload", payload))
            rows.append(f"    {{{array}, {len(frame)}, {array}_payload, {len(payload)}}},")
    return [
        *lines,
        f"inline constexpr soak::Sample samples_of_{end}[] = {{",
        *rows,
        "};",
        f"inline const soak::Sample& from_{end}(std::uint16_t message, std::uint16_t sample) {{",
        f"  return samples_of_{end}[message * samples + sample];",
        "}",
    ]


def _bytes(name: str, data: bytes) -> str:
    return f"inline constexpr std::uint8_t {name}[] = {{{', '.join(str(b) for b in data) or '0'}}};"
