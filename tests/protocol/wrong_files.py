"""The bases for the tables of wrong files: in them `@` marks the place that the error must name."""

import pytest

from wirebond.protocol import ProtocolFileError, loads


def problems_of(text: str) -> list[str]:
    with pytest.raises(ProtocolFileError) as caught:
        loads(text, "rover.yaml")
    return str(caught.value).split("\n")


def marked(text: str) -> tuple[str, str]:
    """The text without its marks, and the place of the first one as an error prints it."""
    before = text[: text.index("@")]
    place = f"rover.yaml:{before.count(chr(10)) + 1}:{len(before) - before.rfind(chr(10))}"
    return text.replace("@", ""), place
