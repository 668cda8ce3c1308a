"""Constants that Python and C++ share: each exists in two languages, and these tests compare them."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from tests.compilers import CXX
from tests.conformance.build import run
from tests.shared import ROOT, codec
from wirebond import Codec, _engine
from wirebond.analysis.explain import examine
from wirebond.protocol import loads, plan, planning
from wirebond.protocol.model import End, cobs_overhead
from wirebond.protocol.tables import format_table, protocol_table

CORE = ROOT / "core" / "include"
LIMITS = ("constants", "checks", "forms", "algorithms", "header_fields", "escapes", "exclusions", "insertion")
PROGRAM = """
#include <cstdio>
#include "wirebond/format.hpp"
int main() {
  std::printf("%zu %zu %zu %zu %zu %zu %zu %zu\\n", wirebond::max_constants, wirebond::max_checks, wirebond::max_forms,
              wirebond::max_algorithms, wirebond::max_header_fields, wirebond::max_escapes,
              wirebond::max_exclusions, wirebond::max_insertion);
  for (std::size_t size = 0; size < 3000; ++size) std::printf("%zu ", wirebond::cobs_overhead(size));
}
"""


@pytest.fixture(scope="module")
def constants(tmp_path_factory: pytest.TempPathFactory) -> list[list[int]]:
    """Return the constants of the C++ headers, a line each."""
    folder = tmp_path_factory.mktemp("constants")
    (folder / "main.cpp").write_text(PROGRAM, encoding="utf-8")
    run([CXX, "-std=c++17", f"-I{CORE}", str(folder / "main.cpp"), "-o", str(folder / "main")])
    return [[int(word) for word in line.split()] for line in run([str(folder / "main")]).splitlines()]


@pytest.mark.live
def test_the_loader_s_limits_are_the_core_s(constants: list[list[int]]) -> None:
    assert [getattr(plan, f"MAX_{name.upper()}") for name in LIMITS] == constants[0]


@pytest.mark.live
def test_cobs_adds_the_same_at_both_ends(constants: list[list[int]]) -> None:
    assert [cobs_overhead(size) for size in range(3000)] == constants[1]


# Every text with the silence after which a link is stale, and the words that hold it.
STALE_TEXTS = {
    "core/include/wirebond/host/link.hpp": "no frame came for a second",
    "core/include/wirebond/mcu/c_api.h": "no valid frame came for a second",
    "core/include/wirebond/mcu/why.h": "no valid frame came for a second",
    "python/src/wirebond/link/link.py": "no frame for a second",
    "python/src/wirebond/ros2/diagnostics.py": "no message came for a second",
    "docs/DESIGN.md": "no valid frame came for a second",
    "docs/firmware.md": "frame for a second",
    "docs/python.md": "a frame came within the last second",
    "docs/TOUR.md": "no frame came for a second",
}
STALE = """
#include <cstdio>
#include "wirebond/deadline.hpp"
int main() { std::printf("%u\\n", static_cast<unsigned>(wirebond::stale_after_us)); }
"""


@pytest.mark.live
def test_both_ends_and_every_text_have_one_stale_time(tmp_path: Path) -> None:
    (tmp_path / "main.cpp").write_text(STALE, encoding="utf-8")
    run([CXX, "-std=c++17", f"-I{CORE}", str(tmp_path / "main.cpp"), "-o", str(tmp_path / "main")])
    assert int(run([str(tmp_path / "main")])) == 1_000_000, "change the texts of STALE_TEXTS too"
    texts = {name: " ".join((ROOT / name).read_text(encoding="utf-8").split()) for name in STALE_TEXTS}
    assert [name for name, text in texts.items() if STALE_TEXTS[name] not in text] == []
    ends = {name: (CORE / "wirebond" / name / "link.hpp").read_text(encoding="utf-8") for name in ("host", "mcu")}
    assert "timeout_us = stale_after_us;" in ends["mcu"] and "< stale_after_us;" in ends["host"]


LENGTHS = (
    "u8",
    "u16",
    "{type: u8, counts: rest}",
    "{type: u8, counts: self_and_rest}",
    "{type: u8, counts: frame}",
    "{type: u8, offset: 2}",
    "{type: u8, counts: rest, offset: -2}",
    "{type: u8, unit: 2}",
    "{type: u8, offset: 4, unit: 4}",
)
SIZES = 1100
CARRIES = """
#include <cstdio>
#include "wirebond/format.hpp"
int main() {{
  const wirebond::Form forms[] = {{{forms}}};
  for (const wirebond::Form& form : forms) {{
    std::printf("%lld ", static_cast<long long>(wirebond::most_payload(form)));
    for (std::size_t size = 0; size < {sizes}; ++size) std::printf("%d ", wirebond::carries(form, size));
    std::printf("\\n");
  }}
}}
"""


def form_with(length: str) -> plan.Form:
    model = loads(
        f"wirebond: 1\nprotocol: told\nmax_payload: 8\nframe:\n  - magic: 0xAA\n  - length: {length}\n  - id: u8\n"
        "  - payload: by_length\n  - check: xor8\nmessages: {m: {id: 1, sender: host, fields: {a: {type: u64}}}}\n"
    )
    return planning.plan_for(model, End.HOST).forms[0]


def form_in_cpp(form: plan.Form) -> str:
    assert form.length is not None
    return (
        "[] { wirebond::Form form; form.payload_size = wirebond::PayloadSize::by_length;"
        f" form.length.bytes = {form.length.bytes}; form.length.mask = {form.length.mask}U;"
        f" form.length_unit = {form.length_unit}; form.length_bias = {form.length_bias}; return form; }}()"
    )


@pytest.mark.live
def test_both_ends_agree_on_the_range_of_a_length(tmp_path: Path) -> None:
    forms = [form_with(length) for length in LENGTHS]
    (tmp_path / "main.cpp").write_text(CARRIES.format(forms=", ".join(map(form_in_cpp, forms)), sizes=SIZES))
    run([CXX, "-std=c++17", f"-I{CORE}", str(tmp_path / "main.cpp"), "-o", str(tmp_path / "main")])
    printed = [[int(word) for word in line.split()] for line in run([str(tmp_path / "main")]).splitlines()]
    assert printed == [[form.most_payload, *(form.carries(size) for size in range(SIZES))] for form in forms]


@pytest.mark.parametrize("size", [1, 252, 253, 254, 255, 507, 508, 509])
def test_no_cobs_frame_is_longer_than_its_greatest(size: int) -> None:
    text = (
        "wirebond: 1\nprotocol: lengthy\nframe:\n  - cobs: [{payload: rest}]\n  - delimiter: 0x00\n"
        f"messages:\n  m: {{sender: host, fields: {{raw: {{type: bytes, size: {size}}}}}}}\n"
    )
    model = loads(text)
    frame = Codec(model).encode("m", {"raw": b"\x01" * size})
    assert len(frame) <= model.max_wire_bytes(size) <= len(frame) + 2


def test_causes_have_the_same_names_in_the_same_order_everywhere() -> None:
    block = re.search(r"enum class Cause[^{]*\{(.*?)\};", (CORE / "wirebond" / "examine.hpp").read_text(), re.DOTALL)
    assert block is not None
    names = re.findall(r"^\s*(\w+)\s*,?", re.sub(r"//.*", "", block[1]), re.MULTILINE)
    told = codec("diffdrive").decoder("host").stats
    assert list(told.discarded_bytes) == list(told.rejected_candidates) == names
    assert [cause.value for cause in examine.Cause if cause] == names
    printed = (ROOT / "tests" / "conformance" / "print.hpp").read_text()
    assert re.findall(r'"(\w+)",', printed.partition("cause_names")[2].partition("};")[0]) == names
    c_names = re.findall(r"WIREBOND_(\w+)", (CORE / "wirebond" / "mcu" / "c_api.h").read_text())
    assert [name.lower() for name in c_names if name.lower() in names][: len(names)] == names


@pytest.mark.parametrize(
    "change",
    [
        {"framing": "by_luck"},
        {"stuffing": "base64"},
        {"algorithms": "kind"},
        {"forms": "payload"},
        {"forms": "order"},
    ],
    ids=str,
)
def test_the_engine_refuses_words_that_it_does_not_know(change: dict[str, str]) -> None:
    """A check of an unknown kind was taken for an exclusive-or."""
    known = planning.plan_for(codec("enterprize").model, End.HOST)
    _engine.FormatTable(format_table(known))
    if "algorithms" in change:
        changed = replace(known, algorithms=(replace(known.algorithms[0], kind="sum9"), *known.algorithms[1:]))
    elif change.get("forms") == "payload":
        changed = replace(known, forms=(replace(known.forms[0], payload="by_luck"),))
    elif change.get("forms") == "order":
        check = replace(known.forms[0].checks[0], order="middle")
        changed = replace(known, forms=(replace(known.forms[0], checks=(check,)),))
    else:
        changed = replace(known, **change)
    with pytest.raises(RuntimeError, match="the engine has no "):
        _engine.FormatTable(format_table(changed))


@pytest.mark.parametrize(("key", "word"), [("kind", "complex"), ("order", "middle"), ("packed", "both")])
def test_the_engine_refuses_fields_that_it_does_not_know(key: str, word: str) -> None:
    model = codec("enterprize").model
    message = next(m for m in model.messages if m.fields)
    field = replace(message.fields[0], **{"count": 2, key: word})
    with pytest.raises(RuntimeError, match="the engine has no "):
        _engine.ProtocolTable(protocol_table(replace(model, messages=(replace(message, fields=(field,)),))))
