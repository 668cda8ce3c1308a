"""The JSON Schema of protocol files, for editors and other tools, made from the grammar.

``wirebond schema`` prints it, and that of mapping files (`wirebond.ros2.mapping.schema`).
"""

from __future__ import annotations

import json
from typing import Any

from wirebond.protocol.text.grammar import File
from wirebond.protocol.text.wording import Syntax

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def json_schema() -> dict[str, Any]:
    """Return a new dict each time; the caller may change it."""
    return schema_of(File, "Wirebond protocol file")


def schema_of(grammar: type[Syntax], title: str) -> dict[str, Any]:
    """Return the schema of the files that this grammar describes. A new dict each time."""
    schema = _tidied(grammar.model_json_schema(mode="validation"))
    assert isinstance(schema, dict)
    return {"$schema": DIALECT, **schema, "title": title}


def schema_text() -> str:
    """Return the schema as a file's text."""
    return text_of(json_schema())


def text_of(schema: dict[str, Any]) -> str:
    """Write the schema as a file."""
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def _tidied_items(named: dict[str, Any]) -> dict[str, Any]:
    """Tidy the items of a mapping whose keys are names of the file, such as `default`: all stay."""
    return {name: _tidied(item) for name, item in named.items()}


def _tidied(value: Any) -> Any:
    """Remove titles made from Python's names, and null: a key has a value or is left out."""
    if isinstance(value, list):
        return [_tidied(item) for item in value]
    if not isinstance(value, dict):
        return value
    schema: dict[str, Any] = {
        key: _tidied_items(entry) if key in ("properties", "$defs") else _tidied(entry)
        for key, entry in value.items()
        if not (key == "title" and isinstance(entry, str)) and not (key == "default" and entry is None)
    }
    if "patternProperties" in schema:
        schema["additionalProperties"] = False  # a name that fits no pattern is not a name
    choices = schema.get("anyOf")
    if choices is not None:
        kept = [choice for choice in choices if choice != {"type": "null"}]
        del schema["anyOf"]
        schema |= kept[0] if len(kept) == 1 else {"anyOf": kept}
    return schema
