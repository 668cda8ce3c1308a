"""Text that is not a protocol file at all: one sentence, soon, whatever it is."""

from pathlib import Path

import pytest

from wirebond.protocol import ProtocolFileError, load, loads
from wirebond.protocol.problems import Problems
from wirebond.protocol.text.yaml_tree import MAX_DEPTH, MAX_FILE_BYTES, MAX_NODES, Mapping, Number, Scalar, parse
from wirebond.visible import visible


def error_of(text: str) -> str:
    with pytest.raises(ProtocolFileError) as caught:
        loads(text, "f")
    return str(caught.value)


def value_of(text: str) -> object:
    root = parse(f"key: {text}", Problems("f"))
    assert isinstance(root, Mapping)
    scalar = root.get("key")
    assert isinstance(scalar, Scalar)
    return scalar.value.value if isinstance(scalar.value, Number) else scalar.value


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("12", 12), ("-12", -12), ("+7", 7), ("010", 10), ("0x1F", 31), ("0o17", 15),
        ("1.5", 1.5), (".5", 0.5), ("1e3", 1000.0), ("1.", 1.0), (".inf", float("inf")),
        ("-.inf", -float("inf")),
        ("true", True), ("False", False), ("null", None), ("~", None), ("", None),
        ("yes", "yes"), ("on", "on"), ("'12'", "12"), ('"true"', "true"), ("0X1F", "0X1F"),
        ("1_000", "1_000"), ("2024-01-01", "2024-01-01"), ("1:30", "1:30"), ("9" * 65, "9" * 65),
    ],
)  # fmt: skip
def test_plain_scalars_follow_the_core_schema_of_yaml_1_2(text: str, value: object) -> None:
    found = value_of(text)
    assert found == value
    assert type(found) is type(value)


def test_a_number_keeps_the_text_that_it_was_written_with() -> None:
    root = parse("a: 0x55\nb: 85\nc: 0.10", Problems("f"))
    assert isinstance(root, Mapping)
    a, b, c = (entry.value.value for entry in root.entries.values() if isinstance(entry.value, Scalar))
    assert isinstance(a, Number)
    assert isinstance(b, Number)
    assert isinstance(c, Number)
    assert (a.value, a.text) == (85, "0x55")
    assert (b.value, b.text) == (85, "85")
    assert str(c.exact()) == "1/10"


def test_every_key_and_value_knows_its_place() -> None:
    root = parse("one: 1\ntwo:\n  - [a, bc]\n  - {k: v}\n", Problems("f"))
    assert isinstance(root, Mapping)
    assert (root.key_place("two").line, root.key_place("two").column) == (2, 1)
    assert (root.value_place("one").line, root.value_place("one").column) == (1, 6)
    assert (root.value_place("two").line, root.value_place("two").column) == (3, 3)


ONE_SENTENCE = [
    ("", "f: the file is empty; a protocol file begins with `wirebond: 1`"),
    ("# a comment\n", "f: the file is empty"),
    (
        "a: b: c",
        "f:1:5: this is not YAML (mapping values are not allowed here); put a text that contains `: ` in",
    ),
    ("a: [1, 2", "f:1:4: this is not YAML (while parsing a flow sequence"),
    (
        "a: 'x\nb: 2\n",
        "f:1:4: this is not YAML (while scanning a quoted scalar found unexpected end of stream); close",
    ),
    (
        'a: 1\nb: "c\nd: 2\n',
        "f:2:4: this is not YAML (while scanning a quoted scalar found unexpected end of stream); "
        "close the quotes that open here",
    ),
    (
        "a: {b: 1\nc: 2\n",
        "f:2:2: this is not YAML (while parsing a flow mapping expected ',' or '}', but got ':'); "
        "separate with commas, and close the `{` of line 1, column 4",
    ),
    (
        "a:\n  - b: 1\n  -c: 2\n",
        "f:3:3: this is not YAML (while parsing a block collection expected <block end>, but found '?'); write a "
        "space after the dash",
    ),
    (
        "a: {b: 1}}\n",
        "f:1:10: this is not YAML (while parsing a block mapping expected <block end>, but found '}'); remove "
        "this `}`, which closes nothing",
    ),
    ("a:\n\tb: 1", "f:2:1: this is not YAML (while scanning for the next token found character '\\t'"),
    (
        "a: 1\n b: 2",
        "f:2:3: this line is indented further than the one above, which has a value; begin it in column 1",
    ),
    (
        "a:\n  b:\n    c: 1\n   d: 2\n",
        "f:4:4: this line begins in column 4, but no block above begins there; begin it in column 3 or 5",
    ),
    (
        "a:\n  b: 1\n # why\n d: 2\n",
        "f:4:2: this line begins in column 2, but no block above begins there; begin it in column 1 or 3",
    ),
    (
        "a:\n  b 1\n  c: 2\n",
        "f:3:4: the line above has no colon; write `key: value`, with a space after the colon",
    ),
    (
        "a:\n  b: 0\n  c 1\n  d: 2\n",
        "f:3:3: this is not YAML (while scanning a simple key could not find expected ':'); write a colon and a space "
        "after this key",
    ),
    ("a: *x", "f:1:4: the alias `*x` has no anchor before it; write `&x` there"),
    ("a: &x [*x]", "f:1:8: the alias `*x` is inside the block that it repeats; write it out"),
    ("a: 1\n---\nb: 2", "f:2:1: a second YAML document begins here; a file holds one protocol"),
    ("%YAML 1.1\n---\na: 1", "f:2:1: protocol files are YAML 1.2; remove the `%YAML` line"),
    ("a: b\x00c", "f:1:5: the character U+0000 is not allowed in YAML"),
    ("a: 1\nb: \x1b[2J", "f:2:4: the character U+001B is not allowed in YAML"),
    ("a: \ud800", "f:1:4: the character U+D800 is not allowed in YAML"),
    ("[" * (MAX_DEPTH + 1) + "]" * (MAX_DEPTH + 1), "f:1:33: nested more than 32 deep"),
    ("[" * 100_000, "f:1:33: nested more than 32 deep"),
    ("{" * 100_000, "f:1:33: nested more than 32 deep"),
    ("- " * 100_000, "f:1:65: nested more than 32 deep"),
    ("? " * 100_000, "f:1:65: nested more than 32 deep"),
    ("-\n" * (MAX_NODES + 1), "f:20000:2: the file has more than 20000 values"),
    ("- a\n" * 60_000, "f:20000:3: the file has more than 20000 values"),
    ("x" * (MAX_FILE_BYTES + 1), "f: the file is larger than 256 KiB"),
    ("é" * (MAX_FILE_BYTES // 2 + 1), "f: the file is larger than 256 KiB"),
    ("\n" * MAX_FILE_BYTES, "f: the file is empty"),
]


@pytest.mark.parametrize(("text", "sentence"), ONE_SENTENCE, ids=range(len(ONE_SENTENCE)))
def test_text_that_is_no_tree_gets_one_sentence(text: str, sentence: str) -> None:
    (line,) = error_of(text).split("\n")
    assert line.startswith(sentence)


def test_a_file_that_doubles_itself_with_aliases_gets_one_sentence() -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 12)]
    (line,) = error_of("\n".join(lines)).split("\n")
    assert line.startswith("f:5:10: the file has more than 20000 values, aliases counted as often as used")


def test_aliases_cannot_nest_deeper_than_lists_may() -> None:
    lines = ["a0: &a0 [x]"] + [f"a{n}: &a{n} [*a{n - 1}]" for n in range(1, 60)]
    (line,) = error_of("\n".join(lines)).split("\n")
    assert "nested more than 32 deep" in line


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("a: 1\nb: 2\na: 3", "f:3:1: the key `a` was given before (line 1, column 1); keep one of the two"),
        ("a: 1\n'a': 3", "f:2:1: the key `a` was given before (line 1, column 1); keep one of the two"),
        (
            "b: &b {c: 1}\na:\n  <<: *b",
            "f:3:3: merge keys (`<<`) are not part of YAML 1.2; write the keys out",
        ),
        ("? [a, b]\n: 1", "f:1:3: a list or mapping cannot be a key"),
        ("a: !!int '3'", "f:1:4: the tag `tag:yaml.org,2002:int` is not used in protocol files; remove it"),
        ("a: !own {b: 1}", "f:1:4: the tag `!own` is not used"),
        ("- a", "f:1:1: a list cannot be used for a protocol file; write a mapping with the keys wirebond, "),
        ("just text", "f:1:1: `just text` cannot be used for a protocol file"),
    ],
)
def test_yaml_that_a_protocol_file_cannot_be_made_of_is_told(text: str, sentence: str) -> None:
    assert [line for line in error_of(text).split("\n") if line.startswith(sentence)]


def file_error(path: Path) -> str:
    with pytest.raises(ProtocolFileError) as caught:
        load(path)
    (problem,) = caught.value.problems
    assert str(problem).startswith(visible(str(path)))
    return str(problem).removeprefix(visible(str(path)))


def test_a_missing_file_a_directory_and_an_impossible_path_get_a_sentence(tmp_path: Path) -> None:
    assert file_error(tmp_path / "none.yaml") == ": there is no such file; check the path"
    folder = ": this is a folder, and a protocol file (YAML) is expected"
    assert (
        file_error(tmp_path)
        == f"{folder}; no .yaml file is in it. `wirebond new {tmp_path}/robot.yaml` writes a first one"
    )
    (tmp_path / "arm.yaml").touch()
    assert file_error(tmp_path) == f"{folder}; name the file in it, such as {tmp_path}/arm.yaml"
    (tmp_path / "base.yml").touch()
    assert file_error(tmp_path).endswith(f"such as {tmp_path}/arm.yaml, or another of its 2 .yaml files")
    assert file_error(tmp_path / "a\0b") == ": a file's name cannot contain a zero byte; check the path"
    assert file_error(tmp_path / ("n" * 5000)).startswith(": cannot be read: ")


def test_bytes_that_are_not_text_get_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "f.yaml"
    path.write_bytes(b"wirebond: 1\nname: \xff\xfe")
    assert file_error(path).startswith(":2:7: this is not UTF-8 text")
    path.write_bytes("wirebond: 1".encode("utf-16"))
    assert "not UTF-8 text" in file_error(path)
    path.write_bytes(bytes(200_000))
    assert file_error(path).startswith(":1:1: the character U+0000 is not allowed in YAML")
    path.write_bytes(bytes(10_000_000))
    assert file_error(path) == ": the file is larger than 256 KiB; a protocol file is some kilobytes of YAML text"


def test_a_byte_order_mark_in_front_is_no_harm(tmp_path: Path) -> None:
    path = tmp_path / "f.yaml"
    text = (
        "wirebond: 1\nprotocol: rover\nframe: [magic: 0x01, id: u8, payload: 0]\nmessages: {a: {id: 1, sender: host}}\n"
    )
    path.write_text(text.replace("\n", "\r\n"), encoding="utf-8-sig", newline="")
    assert load(path).name == "rover"
    assert loads("\ufeff" + text).name == "rover"
