"""Parameters over the service: names, types, ranges, refusals in words, files, and peers that are silent or wrong."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from pathlib import Path

import pytest

import wirebond
from tests.link.mcu import linked
from tests.link.protocol import manipulator
from tests.shared import codec
from tests.waiting import wait_until
from wirebond import MessageError, ParameterError, RequestTimeoutError, UsageError
from wirebond.protocol import loads

pytestmark = [pytest.mark.live, pytest.mark.usefixtures("links")]

NATIVE = codec("native")
NAMED = wirebond.Codec(
    loads("""
wirebond: 1
protocol: named
frame: [magic: 0xA5, id: u8, payload: by_id, check: crc-16/modbus]
messages:
  read:  {id: 1, sender: host, reply: value, fields: {index: {type: u8, enum: {kp: 0, ki: 1, limit: 7}}}}
  set:
    id: 2
    sender: host
    reply: value
    fields:
      index: {type: u8, enum: {kp: 0, ki: 1, limit: 7}}
      value: {type: i32, range: [-1000, 1000]}
  value:
    id: 3
    sender: mcu
    fields: {index: {type: u8}, value: {type: i32}, result: {type: u8}}
services: {parameter: {read: read, set: set, value: value}}
""")
)
INDEX = {"kp": 0, "ki": 1, "limit": 7}


class Named:
    """An MCU of that protocol: it has kp and ki, not limit; ki takes at most 100; result 9 for kp = 13."""

    def __init__(self) -> None:
        self.values = {0: 5, 1: 6}
        self.sets = 0

    def __call__(self, message: wirebond.Message) -> bytes:
        index = INDEX.get(message["index"], message["index"])
        result = 0 if index in self.values else 1
        if message.name == "set":
            self.sets += 1
            if result == 0 and index == 1 and message["value"] > 100:
                result = 2
            if message["value"] == 13:
                result = 9
            if result == 0:
                self.values[index] = message["value"]
        return NAMED.encode("value", index=index, value=self.values.get(index, 0), result=result)


def numbered(least: float = 0.0) -> Callable[[wirebond.Message], bytes]:
    """An MCU of native with three parameters and no names."""
    values = [0.1, 0.2, 3.0]

    def answer(message: wirebond.Message) -> bytes:
        if not message.name.startswith("parameter"):
            return b""
        index = message["index"]
        if index >= len(values):
            return NATIVE.encode("parameter_value", index=index, value=0, result="no_such_index")
        result = "ok"
        if message.name == "parameter_set":
            if message["value"] < least:
                result = "out_of_range"
            else:
                values[index] = message["value"]
        return NATIVE.encode("parameter_value", index=index, value=values[index], result=result)

    return answer


def test_names_of_the_file_are_those_of_the_parameters() -> None:
    with linked(NAMED, Named()) as (link, _):
        parameters = link.parameters
        assert parameters.names == ("kp", "ki", "limit")
        told: list[tuple[int, int]] = []
        assert parameters.list(lambda done, of: told.append((done, of))) == {"kp": 5, "ki": 6}  # limit is not there
        assert told == [(1, 3), (2, 3), (3, 3)]
        assert parameters.set("ki", 100) == 100
        assert (parameters.get("ki"), parameters.get(1), parameters.get("1")) == (100, 100, 100)
        assert type(parameters.get("ki")) is int


def test_a_table_without_names_is_read_by_index_until_its_end() -> None:
    with linked(NATIVE, numbered()) as (link, _):
        assert link.parameters.names == ()
        assert link.parameters.list() == {"0": 0.1, "1": 0.2, "2": 3.0}  # as floats of 32 bits are written
        assert link.parameters.set(2, 0.7) == 0.7


def test_a_refusal_has_the_mcus_reason_in_words() -> None:
    with linked(NAMED, Named()) as (link, _):
        parameters = link.parameters
        with pytest.raises(
            ParameterError,
            match=r"refused 101 for parameter ki: it is out of range; 6 stays in force\. "
            r"The file here allows -1000 to 1000, and the MCU less",
        ) as e:
            parameters.set("ki", 101)
        assert (e.value.parameter, e.value.reason, e.value.value) == ("ki", "out_of_range", 6)
        again = pickle.loads(pickle.dumps(e.value))
        assert (str(again), again.reason, again.value) == (str(e.value), "out_of_range", 6)
        with pytest.raises(ParameterError, match="the MCU has no parameter limit"):
            parameters.get("limit")
        with pytest.raises(ParameterError, match="the MCU refused parameter kp: 9; 5 stays in force"):
            parameters.set("kp", 13)
        with pytest.raises(ParameterError, match="named has no parameter 'kd'; it has kp, ki, limit"):
            parameters.get("kd")
        with pytest.raises(ParameterError, match="an index of named is 0 to 255, not 256"):
            parameters.get(256)


@pytest.mark.parametrize("value", [1001, 0.5, "5", True, None, float("nan")])
def test_a_value_of_another_type_or_out_of_the_files_range_is_not_sent(value: object) -> None:
    mcu = Named()
    with linked(NAMED, mcu) as (link, _), pytest.raises(MessageError, match=r"set\.value"):
        link.parameters.set("kp", value)  # type: ignore[arg-type]
    assert mcu.sets == 0


def test_an_answer_for_another_parameter_is_none() -> None:
    with linked(NAMED, lambda _: NAMED.encode("value", index=1, value=3, result=0)) as (link, _):
        with pytest.raises(ParameterError, match="the MCU answered for parameter 1 instead of kp") as caught:
            link.parameters.get("kp")
        assert caught.value.reason == "wrong_index"


def test_a_read_is_asked_three_times_and_a_set_once() -> None:
    with linked(NAMED) as (link, mcu):
        with pytest.raises(RequestTimeoutError, match=r"no value within 0\.05 s of read"):
            link.parameters.get("kp", timeout=0.05)
        with pytest.raises(RequestTimeoutError, match=r"no value within 0\.05 s of set"):
            link.parameters.set("kp", 1, timeout=0.05)
        wait_until(lambda: len(mcu.heard) == 4, "all are heard")
        assert [m.name for m in mcu.heard] == ["read", "read", "read", "set"]


def test_an_answer_that_was_lost_is_asked_for_again() -> None:
    mcu, asked = Named(), []

    def forgetful(message: wirebond.Message) -> bytes:
        asked.append(message)
        return b"" if len(asked) == 1 else mcu(message)

    with linked(NAMED, forgetful) as (link, _):
        assert link.parameters.get("kp", timeout=9) == 5


def test_a_file_without_the_service_says_so() -> None:
    with linked(manipulator()) as (link, _), pytest.raises(UsageError, match="manipulator maps no `parameter` service"):
        link.parameters.list()


# ---- several at once


def test_all_are_set_or_none() -> None:
    mcu = Named()
    with linked(NAMED, mcu) as (link, _):
        told: list[tuple[int, int]] = []
        assert link.parameters.set_all({"kp": 7, "1": 8}, lambda done, of: told.append((done, of))) == {"kp": 7, "1": 8}
        assert told == [(1, 2), (2, 2)]
        with pytest.raises(ParameterError, match="nothing was set; 1 refused:\n  ki: the MCU refused 500"):
            link.parameters.set_all({"kp": 9, "ki": 500})
        assert mcu.values == {0: 7, 1: 8}


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"kp": 9, "ki": 2000}, "outside -1000 ... 1000"),
        ({"kp": 9, "kd": 1}, "named has no parameter 'kd'"),
        ({"kp": 9, "limit": 1}, "the MCU has no parameter limit"),
        ({"kp": 9, "0": 1}, "it is the same parameter as kp; give one of them"),
    ],
)
def test_all_are_checked_before_the_first_is_set(values: dict[str, float], sentence: str) -> None:
    mcu = Named()
    with linked(NAMED, mcu) as (link, _), pytest.raises(ParameterError, match=sentence):
        link.parameters.set_all(values)
    assert mcu.sets == 0


def test_values_that_cannot_be_set_back_are_named() -> None:
    mcu = Named()

    def once(message: wirebond.Message) -> bytes:
        """Refuses every set after the first."""
        before = dict(mcu.values)
        answer = mcu(message)
        if message.name == "set" and mcu.sets > 1:
            mcu.values = before
            index = INDEX[message["index"]]
            return NAMED.encode("value", index=index, value=before[index], result=2)
        return answer

    with (
        linked(NAMED, once) as (link, _),
        pytest.raises(ParameterError, match="nothing was set, except that kp could not be set back to 5: the MCU"),
    ):
        link.parameters.set_all({"kp": 9, "ki": 7})
    assert mcu.values == {0: 9, 1: 6}


def test_all_are_set_back_where_an_answer_is_missing() -> None:
    mcu = Named()

    def forgetful(message: wirebond.Message) -> bytes:
        """Its second set takes effect, and is not answered."""
        answer = mcu(message)
        return b"" if message.name == "set" and mcu.sets == 2 else answer

    with linked(NAMED, forgetful) as (link, _):
        with pytest.raises(RequestTimeoutError, match=r"\nnothing was set$") as caught:
            link.parameters.set_all({"kp": 9, "ki": 7}, timeout=5)
        assert mcu.values == {0: 5, 1: 6}
    assert caught.value.message == "set"


# ---- files


@pytest.mark.parametrize("ending", ["yaml", "yml", "json"])
def test_a_saved_layout_can_be_loaded(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"gains.{ending}"
    with linked(NATIVE, numbered()) as (link, _):
        parameters = link.parameters
        saved = parameters.save(path)
        for name in saved:
            parameters.set(name, 9.0)
        assert parameters.load(path) == saved == parameters.list() == {"0": 0.1, "1": 0.2, "2": 3.0}
    assert "0.1" in path.read_text()


def test_nothing_is_set_where_a_file_has_something_wrong(tmp_path: Path) -> None:
    path = tmp_path / "gains.yaml"
    path.write_text("kp: 1\nkd: 2\nki: 2000\nlimit: 3\n")
    mcu = Named()
    with linked(NAMED, mcu) as (link, _), pytest.raises(ParameterError, match="nothing was set; 3 refused:") as caught:
        link.parameters.load(path)
    assert set(caught.value.refused) == {"kd", "ki", "limit"}
    assert "has no parameter 'kd'" in caught.value.refused["kd"]
    assert "outside -1000 ... 1000" in caught.value.refused["ki"]
    assert "the MCU has no parameter limit" in str(caught.value)
    assert mcu.sets == 0


def test_nothing_of_a_file_stays_set_where_the_mcu_refuses_a_value(tmp_path: Path) -> None:
    path = tmp_path / "gains.json"
    path.write_text(json.dumps({"kp": 8, "ki": 500}))
    mcu = Named()
    with linked(NAMED, mcu) as (link, _):
        with pytest.raises(
            ParameterError, match=r"gains\.json: nothing was set; 1 refused:\n  ki: the MCU refused 500"
        ) as caught:
            link.parameters.load(path)
        assert mcu.values == {0: 5, 1: 6}
    assert (caught.value.parameter, caught.value.reason, caught.value.value) == ("ki", "out_of_range", 6)


@pytest.mark.parametrize(
    ("name", "text", "sentence"),
    [
        ("a.yaml", "kp: 1\nkp: 2\n", r"a\.yaml:2:1: it is not valid YAML: found duplicate key"),
        ("a.yaml", '1: 1\n"1": 2\n', r"a\.yaml: 1 is listed twice; remove one of them"),
        ("a.json", "\ufeff{", "it cannot be read as JSON: Expecting property name"),  # of Windows: what follows counts
        ("a.yaml", "kp: [\n", r"a\.yaml:2:1: it is not valid YAML"),
        ("a.yaml", "- 1\n", "expected names and values, such as `kp: 1.5`"),
        ("a.yaml", "", "expected names and values"),
        ("a.yaml", "kp: fast\n", "nothing was set; 1 refused:\n  kp: set.value is 'fast'; expected a number"),
        ("a.json", '{"kp": 1, "kp": 2}', "it cannot be read as JSON: a name stands twice"),
        ("a.json", "{", "it cannot be read as JSON"),
        ("a.json", "[" * 100_000, "it cannot be read as JSON"),
        ("a.json", '{"kp": NaN}', "nothing was set; 1 refused"),
        ("a.yaml", "kp: 1 #" + "x" * (1 << 20), "has more than 1048576 bytes"),
    ],
)
def test_a_file_that_cannot_be_used_is_a_sentence(tmp_path: Path, name: str, text: str, sentence: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    mcu = Named()
    with linked(NAMED, mcu) as (link, _):
        with pytest.raises(ParameterError, match=sentence):
            link.parameters.load(path)
        with pytest.raises(UsageError, match=r"a\.txt has an unknown ending; name a file such as a\.yaml"):
            link.parameters.load(path.with_suffix(".txt"))
    assert mcu.sets == 0
