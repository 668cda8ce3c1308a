"""The base of the grammar's mappings: it turns a validator's errors into sentences in the file's words."""

from __future__ import annotations

from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict, ModelWrapValidatorHandler, ValidationError, model_validator
from pydantic_core import InitErrorDetails, PydanticCustomError

from wirebond.protocol.problems import quoted, suggestion
from wirebond.protocol.text.scalars import describe, wrong


class Syntax(BaseModel):
    """A mapping of the file. Its errors are sentences in the file's words."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, defer_build=True)

    #: What such a mapping is called in a sentence.
    noun: ClassVar[str] = "this mapping"
    #: Text for its place in a list of alternatives; `or` comes after it.
    short: ClassVar[str] = ""

    @model_validator(mode="wrap")
    @classmethod
    def _in_the_files_words(cls, value: Any, handler: ModelWrapValidatorHandler[Any]) -> Any:
        if not isinstance(value, dict):
            keys = ", ".join(cls.known_keys())
            raise wrong(
                f"{describe(value)} cannot be used for {cls.noun}; write {cls.short}a mapping with the keys {keys}"
            )
        empty = [key for key in cls.known_keys() if key in value and value[key] is None]
        errors: list[InitErrorDetails] = [
            {
                "type": wrong(f"`{key}` has no value; {cls._advice(key)}", "wrong_key"),
                "loc": (key,),
                "input": None,
            }
            for key in empty
        ]
        try:
            result = handler(value)
        except ValidationError as error:
            for line in error.errors(include_url=False):
                if line["loc"] and line["loc"][0] in empty:
                    continue
                wording = cls._worded(line["type"], line["loc"], line.get("ctx", {}), line["input"])
                errors.append({"type": wording, "loc": line["loc"], "input": line["input"]})
        if errors:
            raise ValidationError.from_exception_data(cls.__name__, errors)
        return result

    @classmethod
    def known_keys(cls) -> list[str]:
        return list(cls.model_fields)

    @classmethod
    def _advice(cls, key: str) -> str:
        examples = cls.model_fields[key].examples
        return f"write for example `{key}: {examples[0]}`" if examples else f"write `{key}:` and its value"

    @classmethod
    def _worded(cls, kind: str, loc: tuple[int | str, ...], facts: dict[str, Any], value: Any) -> PydanticCustomError:
        key = str(loc[-1]) if loc else ""
        if "sentence" in facts:
            return PydanticCustomError(kind, "{sentence}", facts)  # worded already, further in
        if kind == "missing":
            return wrong(f"{cls.noun} needs `{key}`; {cls._advice(key)}", "wrong_key")
        if kind == "extra_forbidden" and value is None and key.isdecimal():  # after a comma
            return wrong(f"`{key}` is not a key; write a decimal number with a point, such as `0.{key}`", "wrong_key")
        if kind == "extra_forbidden":
            return wrong(f"{quoted(key)} is not a key of {cls.noun}; {suggestion(key, cls.known_keys())}", "wrong_key")
        if kind in ("dict_type", "model_type", "model_attributes_type"):
            return wrong(f"{describe(value)} is not possible here; write a mapping: lines of `name: value`")
        if kind == "list_type":
            return wrong(f"{describe(value)} is not possible here; write a list: lines that begin with `- `, or [a, b]")
        if kind in ("too_short", "too_long"):
            few = kind == "too_short"
            limit = f"it needs at least {facts['min_length']}" if few else f"it takes at most {facts['max_length']}"
            amount = f"too {'few' if few else 'many'} entries ({facts['actual_length']})"
            return wrong(f"`{key}` has {amount}; {limit}")
        raise AssertionError(f"no wording for {kind} at {loc}")
