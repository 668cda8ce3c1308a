"""Whatever is in a file: a protocol, or a refusal whose every problem has a place and a sentence."""

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator
from ruamel.yaml import YAML

from wirebond.protocol import ProtocolFileError, loads, protocol_hash
from wirebond.protocol.model import End
from wirebond.protocol.planning import plan_for
from wirebond.protocol.text.schema import json_schema

PROTOCOLS = Path(__file__).parents[2] / "protocols"
VALIDATOR = Draft202012Validator(json_schema())
TREES: list[Any] = [
    YAML(typ="safe", pure=True).load((PROTOCOLS / f"{name}.yaml").read_text(encoding="utf-8"))
    for name in ("diffdrive", "native", "pid_tuner", "pid_tuner_listing")
]
SHAPES = Path(__file__).parents[1] / "generate" / "code" / "every_shape.yaml"
TREES.append(YAML(typ="safe", pure=True).load(SHAPES.read_text(encoding="utf-8")))
WORDS = [
    *(
        "0x00",
        "by_id",
        "by_length",
        "rest",
        "u8",
        "u16be",
        "u64",
        "f32",
        "text",
        "bytes",
        "bool",
        "host",
        "mcu",
    ),
    *(
        "both",
        "xor8",
        "crc-32",
        "crc",
        "id..payload",
        "payload",
        "idle",
        "velocity",
        "pid",
        "cobs",
        "delimiter",
    ),
    *("magic", "length", "id", "check", "fields", "type", "count", "size", "max", "scale", "range", "enum"),
    *("flags", "default", "-", "bits", "struct", "group", "packed", "to_end", "point", "padding", "u11", "s16", "n"),
]

scalars = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(2**70), 2**70),
    st.integers(-3, 300),
    st.floats(),
    st.text(max_size=12),
    st.sampled_from(WORDS),
    st.sampled_from(["50 ms", "0x55", "1e400", "20 Hz", "0x01 0x02"]),
)
values = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(WORDS), inner, max_size=3),
)


def paths_in(tree: Any) -> list[tuple[Any, ...]]:
    found: list[tuple[Any, ...]] = []
    steps: Any = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for step, inner in steps:
        found += [(step,), *((step, *rest) for rest in paths_in(inner))]
    return found


PATHS = [paths_in(tree) for tree in TREES]


def loads_or_explains(text: str) -> bool:
    """True if it is a protocol. Fails if it is neither that nor a proper refusal."""
    refusal: ProtocolFileError | None = None
    try:
        protocol = loads(text, "f")
    except ProtocolFileError as error:
        refusal = error
    if refusal is not None:
        assert refusal.problems
        assert list(refusal.problems) == sorted(set(refusal.problems))
        for problem in refusal.problems:
            assert 0 <= problem.line <= text.count("\n") + 2
            assert "; " in problem.sentence
            assert "\n" not in str(problem)
        return False
    for end in (End.HOST, End.MCU):
        plan_for(protocol, end)
    assert 0 <= protocol_hash(protocol) < 2**64
    return True


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_a_good_file_with_nodes_replaced_or_removed_is_a_protocol_or_a_refusal(data: st.DataObject) -> None:
    which = data.draw(st.integers(0, len(TREES) - 1))
    tree = json.loads(json.dumps(TREES[which]))
    for path in data.draw(st.lists(st.sampled_from(PATHS[which]), min_size=1, max_size=3)):
        parent = tree
        for step in path[:-1]:
            if isinstance(parent, (dict, list)) and (step in parent or isinstance(parent, list)):
                try:
                    parent = parent[step]
                except (IndexError, TypeError):
                    break
        if not isinstance(parent, (dict, list)):
            continue
        try:
            if data.draw(st.booleans()):
                parent[path[-1]] = data.draw(values)
            else:
                del parent[path[-1]]
        except (IndexError, KeyError, TypeError):
            continue
    text = json.dumps(tree)  # JSON is YAML
    if loads_or_explains(text):
        problems = [error.message for error in VALIDATOR.iter_errors(YAML(typ="safe", pure=True).load(text))]
        assert problems == [], "the loader takes what the published schema refuses"


@settings(max_examples=150, deadline=None)
@given(text=st.text(alphabet=st.sampled_from(list("abc:-[]{},&*!|>'\"%@`#?~ \n\t0x1.")), max_size=60))
def test_any_text_is_a_protocol_or_a_refusal(text: str) -> None:
    loads_or_explains(text)


@settings(max_examples=100, deadline=None)
@given(data=st.data())
def test_a_good_file_that_is_cut_or_garbled_is_a_protocol_or_a_refusal(data: st.DataObject) -> None:
    text = (PROTOCOLS / "pid_tuner_listing.yaml").read_text(encoding="utf-8")
    begin = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(begin, min(len(text), begin + 40)))
    loads_or_explains(text[:begin] + data.draw(st.text(max_size=8)) + text[end:])


@pytest.mark.parametrize("cut", range(0, 900, 37))
def test_a_truncated_file_is_refused_or_whole(cut: int) -> None:
    loads_or_explains((PROTOCOLS / "diffdrive.yaml").read_text(encoding="utf-8")[:cut])
