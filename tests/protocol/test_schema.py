"""The published JSON Schema: up to date, and of one mind with the loader."""

from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from ruamel.yaml import YAML

from wirebond.protocol import ProtocolFileError, loads
from wirebond.protocol.text.schema import json_schema

PROTOCOLS = Path(__file__).parents[2] / "protocols"
VALIDATOR = Draft202012Validator(json_schema())


def tree(text: str) -> Any:
    return YAML(typ="safe", pure=True).load(text)


def test_the_schema_is_a_schema() -> None:
    Draft202012Validator.check_schema(json_schema())


@pytest.mark.parametrize("path", sorted(PROTOCOLS.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_protocol_of_the_project_is_valid(path: Path) -> None:
    assert [error.message for error in VALIDATOR.iter_errors(tree(path.read_text(encoding="utf-8")))] == []


def test_every_shape_of_fields_is_valid() -> None:
    text = (Path(__file__).parents[1] / "generate" / "code" / "every_shape.yaml").read_text(encoding="utf-8")
    assert [error.message for error in VALIDATOR.iter_errors(tree(text))] == []


def test_every_key_of_the_file_is_described() -> None:
    def undescribed(schema: Any, where: str) -> list[str]:
        if isinstance(schema, list):
            return [found for item in schema for found in undescribed(item, where)]
        if not isinstance(schema, dict):
            return []
        keys = schema.get("properties", {})
        missing = [f"{where}.{key}" for key, entry in keys.items() if "description" not in entry]
        return missing + [found for key, entry in schema.items() for found in undescribed(entry, f"{where}.{key}")]

    assert undescribed(json_schema(), "") == []


FILE = """\
wirebond: 1
protocol: rover
link: {baud: 115200}
frame: [magic: 0x01, id: u8, payload: by_id, check: crc-16/modbus]
messages:
  drive: {id: 1, sender: host, every: 50 ms, fields: {speed: {type: i16, scale: 0.1, range: [-1, 1]}}}
"""


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("wirebond: 1", "wirebond: 2"),
        ("wirebond: 1\n", ""),
        ("rover", "Rover"),
        ("link:", "lnk:"),
        ("link: {baud: 115200}", "link:"),
        ("115200", "fast"),
        ("115200", "1"),
        ("0x01", "one"),
        ("0x01", "0x01 2"),
        ("id: u8,", "id: u64,"),
        ("by_id", "by_idd"),
        ("crc-16/modbus", "crc16"),
        ("crc-16/modbus", "{type: crc-16/modbus, over: 3}"),
        ("magic: 0x01,", "magc: 0x01,"),
        ("drive:", "dri-ve:"),
        ("drive:", "drive_:"),
        ("sender: host", "sender: hots"),
        ("sender: host, ", ""),
        ("50 ms", "50"),
        ("50 ms", "50 min"),
        ("every:", "evry:"),
        ("i16", "int16"),
        ("0.1", "tenth"),
        ("[-1, 1]", "[-1]"),
        ("[-1, 1]", "{min: -1}"),
    ],
)
def test_the_loader_refuses_all_that_the_schema_refuses(old: str, new: str) -> None:
    assert VALIDATOR.is_valid(tree(FILE))
    assert loads(FILE)
    wrong = FILE.replace(old, new)
    assert not VALIDATOR.is_valid(tree(wrong))
    with pytest.raises(ProtocolFileError):
        loads(wrong)
