"""The C++ header that a soak's program is compiled with."""

from __future__ import annotations

from wirebond.codec import Codec
from wirebond.generate.code.cpp_names import struct_names
from wirebond.generate.code.names import namespace
from wirebond.protocol.model import End, Queue, Stuffing
from wirebond.protocol.planning import plan_for
from wirebond.sim.soak.mix import Mix, Turn
from wirebond.sim.soak.samples import SAMPLES, samples
from wirebond.sim.soak.tables import rows


def header(codec: Codec, mix: Mix) -> str:
    """Write ``mix.hpp``, which the soak's C++ program includes beside the generated headers."""
    model = codec.model
    structs = struct_names(model)
    host = list(dict.fromkeys(turn.message for turn in mix.host))
    mcu = list(dict.fromkeys(turn.message for turn in mix.mcu))
    actions = dict.fromkeys(d.then for d in model.deadlines if d.at == End.MCU)
    heard = plan_for(model, End.MCU)
    index = codec.tables.indices
    latest = [str(model.message(name).queue == Queue.LATEST).lower() for name in mcu]
    has_order = all(model.message(name).queue == Queue.NORMAL for name in mcu)
    is_resized = heard.sequence is not None and heard.stuffing != Stuffing.NONE
    lines = [
        f"// Made by `wirebond soak` from {model.name}: the load that both ends offer.",
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
        f"inline constexpr bool host_numbers = {_cpp(plan_for(model, End.HOST).sequence is not None)};",
        f"inline constexpr bool overtakes = {_cpp(not has_order)};  ///< frames of the MCU overtake others",
        f"inline constexpr bool reads_runs = {_cpp(is_resized or not has_order)};",
        f"inline constexpr std::array<bool, {max(len(mcu), 1)}> is_latest{{{', '.join(latest)}}};",
        f"inline constexpr bool matches = {_cpp(heard.matches)};",
        f"inline constexpr bool matches_late = {_cpp(heard.matches_late)};",
        "",
        "struct Actions {",
        *(f"  void {action}() {{}}" for action in actions),
        "};",
        "",
        *_frames(codec, "host", host, End.HOST),
        *_frames(codec, "mcu", mcu, End.MCU),
        "",
        *rows("rows_from_mcu", heard),
        *rows("rows_from_host", plan_for(model, End.HOST)),
        _places("host_message", [index[name] for name in host]),
        _places("mcu_message", [index[name] for name in mcu]),
        "inline std::int16_t host_index(std::uint16_t message) {",
        f"  constexpr std::int16_t indices[] = {{{', '.join(str(index[name]) for name in host) or '-1'}}};",
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
        *(f"    case {i}: return link.send(values_{i}[sample]);" for i in range(len(mcu))),
        "    default: static_cast<void>(link), static_cast<void>(sample); return wirebond::Status::link_down;",
        "  }",
        "}",
        "",
        "}  // namespace mix",
        "",
    ]
    return "\n".join(lines)


def _cpp(value: bool) -> str:
    return str(value).lower()


def _turns(name: str, turns: tuple[Turn, ...], messages: list[str]) -> str:
    rows = ", ".join(f"Turn{{{messages.index(turn.message)}, {turn.times}}}" for turn in turns)
    return f"inline constexpr std::array<Turn, {len(turns)}> {name}{{{rows}}};"


def _places(name: str, indices: list[int]) -> str:
    """Map a message's index in the file to its place here; one that is not offered has none, and matches nothing."""
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
        *(rows or ["    {nullptr, 0, nullptr, 0},"]),
        "};",
        f"inline const soak::Sample& from_{end}(std::uint16_t message, std::uint16_t sample) {{",
        f"  return samples_of_{end}[message * samples + sample];",
        "}",
    ]


def _bytes(name: str, data: bytes) -> str:
    return f"inline constexpr std::uint8_t {name}[] = {{{', '.join(str(b) for b in data) or '0'}}};"
