"""Whatever is given as a header: a protocol file that loads, or a sentence with a place and advice."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from wirebond.errors import HeaderFileError
from wirebond.import_ import import_header
from wirebond.import_.preprocess import MAX_FILE_BYTES
from wirebond.protocol import loads

GOOD = "struct good { int x; };\n"
DOUBLING = "".join(f"#define A{i} A{i + 1} A{i + 1} A{i + 1} A{i + 1}\n" for i in range(20)) + "int x = A0;\n"


def refusal(tmp_path: Path, text: str | bytes) -> str:
    header = tmp_path / "bad.h"
    header.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(HeaderFileError) as caught:
        import_header(header, "bad")
    return str(caught.value).replace(str(tmp_path), "")


@pytest.mark.parametrize(
    ("text", "place", "sentence"),
    [
        ("", "/bad.h: ", "it declares no struct with members"),
        ("struct a { int x; }", "/bad.h:", "not C that can be read here"),
        (
            "struct a {\n  int x;\n  vec3 position;\n};",
            "/bad.h:3:1: ",
            "the type `vec3` is not known here; add its typedef",
        ),
        ("class A { public: int x; };", "/bad.h:1:1: ", "C++ is not read"),
        ("enum class Mode : int { A };", "/bad.h:1:1: ", "C++ is not read"),
        ("#if VERSION > 3\nint a;\n#endif\n", "/bad.h:1:1: ", "the condition `VERSION > 3` is not decided here"),
        ("#ifdef A\nint a;\n", "/bad.h:3:1: ", "an `#if` has no `#endif`"),
        ("#endif\n", "/bad.h:1:1: ", "has no `#if`"),
        ("#error stop\n", "/bad.h:1:1: ", "the header refuses to be read so: stop"),
        ("#define F(x) x\nstruct a { int F(y); };\n", "/bad.h:2:1: ", "the macro `F` takes arguments"),
        ("#pragma pack(3)\n", "/bad.h:1:1: ", "`#pragma pack` with `3`"),
        ("struct a { int x __attribute__((aligned(8))); };", "/bad.h:1:1: ", "an alignment of its own"),
        (DOUBLING, "/bad.h:21:1: ", "go too deep"),
        (b"\x7fELF\0\0", "/bad.h: ", "not a text file"),
        (b"/" * (MAX_FILE_BYTES + 1), "/bad.h: ", "larger than"),
        ("(" * 5000, "/bad.h: ", "nested 5000 deep"),
        ("struct a { struct a x; };", "/bad.h: ", "it contains itself"),
        ("struct a { void *p; };", "/bad.h: ", "p is a pointer"),
    ],
    ids=range(18),
)
def test_a_sentence_says_where_and_what_to_do(tmp_path: Path, text: str | bytes, place: str, sentence: str) -> None:
    said = refusal(tmp_path, text)
    assert said.startswith(place), said
    assert sentence in said


def test_structs_nested_without_end_are_refused_in_time(tmp_path: Path) -> None:
    """Each level holds the one before many times: sizes must not be worked out again and again."""
    levels = "".join(
        f"struct s{i} {{ {' '.join(f'struct s{i - 1} m{j};' for j in range(8))} }};\n" for i in range(1, 60)
    )
    started = time.monotonic()
    header = tmp_path / "deep.h"
    header.write_text("struct s0 { char a; };\n" + levels + GOOD)
    found = import_header(header, "deep")
    assert time.monotonic() - started < 20
    assert [message.name for message in loads(found.text).messages] == ["good"]
    assert any("nested more than 32 deep" in note for note in found.notes)


def test_a_struct_of_too_many_fields_is_left_out(tmp_path: Path) -> None:
    header = tmp_path / "wide.h"
    header.write_text("struct p { char a; char b; };\nstruct wide { struct p all[40000]; };\n" + GOOD)
    found = import_header(header, "wide")
    assert found.notes == ("wide (line 2): it is too large for a message",)


WORDS = (
    "struct union enum typedef { } ; , [ ] ( ) * : = 0 1 3 a b x_t uint8_t uint16_t float char unsigned long int "
    '__attribute__((packed)) PACKED #define #ifdef #endif #if #else #pragma pack(1) pack(push,1) pack(pop) // /* */ "'
)
PIECES = st.sampled_from([*WORDS.split(), "\\", "\n"])


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(PIECES, max_size=40).map(" ".join))
def test_any_text_gives_a_file_that_loads_or_a_sentence(tmp_path: Path, text: str) -> None:
    header = tmp_path / "any.h"
    header.write_text(text)
    try:
        found = import_header(header, "any")
    except HeaderFileError:
        return  # a sentence; any other exception fails the test
    loads(found.text)
