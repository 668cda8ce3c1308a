"""Whatever is given as a header: a protocol file that loads, or a sentence with a place and advice."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.cost import calls

from wirebond.errors import HeaderFileError
from wirebond.generate.from_header import import_header
from wirebond.generate.from_header.names import Names
from wirebond.generate.from_header.preprocess import MAX_FILE_BYTES
from wirebond.protocol import loads
from wirebond.protocol import names as protocol_names

GOOD = "struct good { int x; };\n"
DOUBLING = "".join(f"#define A{i} A{i + 1} A{i + 1} A{i + 1} A{i + 1}\n" for i in range(20)) + "int x = A0;\n"
MANY_FIELDS = "".join(f"struct s{i} {{ {' '.join(f'int x{j};' for j in range(100))} }};\n" for i in range(60))


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
        ("struct a { int x __attribute__((aligned(8))); };", "/bad.h:1:1: ", "the importer does not support `aligned`"),
        (DOUBLING, "/bad.h:21:1: ", "go too deep"),
        (b"\x7fELF\0\0", "/bad.h: ", "not a text file"),
        (b"/" * (MAX_FILE_BYTES + 1), "/bad.h: ", "larger than"),
        ("(" * 5000, "/bad.h: ", "nested 5000 deep"),
        ("struct a { struct a x; };", "/bad.h: ", "it contains itself"),
        ("struct a { void *p; };", "/bad.h: ", "p is a pointer"),
        (f"struct a {{ int x[{'9' * 5000}]; }};", "/bad.h: ", "cannot calculate a size or value"),
        (f"enum e {{ A = {'+'.join('1' * 5000)} }};\n{GOOD}", "/bad.h: ", "has too many operators"),
        (MANY_FIELDS, "/bad.h: ", "would be too large; import fewer structs at once"),
        ("enum e { A = 0xFFFFFFFFFFFFFFFF, B = -1 }; struct a { enum e x; };", "/bad.h: ", "do not fit one integer"),
    ],
    ids=range(22),
)
def test_a_sentence_says_where_and_what_to_do(tmp_path: Path, text: str | bytes, place: str, sentence: str) -> None:
    said = refusal(tmp_path, text)
    assert said.startswith(place), said
    assert sentence in said


def test_structs_nested_without_end_are_refused_in_time(tmp_path: Path) -> None:
    """Each level holds the one before many times: sizes must not be worked out again and again."""
    header = tmp_path / "deep.h"

    def cost(depth: int) -> int:
        members = (" ".join(f"struct s{i} m{j};" for j in range(8)) for i in range(depth))
        levels = "".join(f"struct s{i} {{ {each} }};\n" for i, each in enumerate(members, 1))
        header.write_text("struct s0 { char a; };\n" + levels + GOOD)
        return calls(lambda: import_header(header, "deep"))

    costs = cost(30), cost(60)
    assert costs[1] < 3 * costs[0], costs
    found = import_header(header, "deep")
    assert [message.name for message in loads(found.text).messages] == ["good"]
    assert any("nested more than 32 deep" in note for note in found.notes)


def test_a_struct_of_too_many_fields_is_left_out(tmp_path: Path) -> None:
    header = tmp_path / "wide.h"
    header.write_text("struct p { char a; char b; };\nstruct wide { struct p all[40000]; };\n" + GOOD)
    found = import_header(header, "wide")
    assert found.notes == ("wide (line 2): it is too large for a message",)


def test_the_work_for_names_grows_with_the_structs_and_not_with_their_square(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """8 000 structs took minutes: each name was compared with all names before it. Work is counted, not time."""
    calls = 0
    plain_type_name = protocol_names.type_name

    def type_name(name: str) -> str:
        nonlocal calls
        calls += 1
        return plain_type_name(name)

    monkeypatch.setattr(protocol_names, "type_name", type_name)
    header = tmp_path / "many.h"
    for shape in ("struct s{0} {{ int x; }};\n", "struct s{0}_a {{ int x; }};\nstruct s{0}A {{ int x; }};\n"):
        header.write_text("".join(shape.format(number) for number in range(1000)))
        calls = 0
        with pytest.raises(HeaderFileError, match="more than 255 structs; import fewer at once"):
            import_header(header, "many")
        assert calls <= 10 * 1000
    taken = Names(are_types=True)
    calls = 0
    assert [taken.take("Same_t") for _ in range(1000)][-1] == "same_1000"
    assert calls <= 5 * 1000


def test_an_enum_of_more_names_than_a_file_holds_is_left_out_with_its_reason(tmp_path: Path) -> None:
    header = tmp_path / "names.h"
    names = ", ".join(f"E_NAME_{i}" for i in range(20_000))
    header.write_text(f"enum e {{ {names} }};\nstruct a {{ enum e x; }};\n" + GOOD)
    found = import_header(header, "names")
    assert [message.name for message in loads(found.text).messages] == ["a", "good"]
    assert found.notes == (
        "enum e is left out, and its fields are plain integers: it has 20000 names, and at most 1000 are possible",
    )


def test_an_enum_whose_values_need_8_bytes_takes_8(tmp_path: Path) -> None:
    header = tmp_path / "wide.h"
    header.write_text("enum e { A = 0x7fffffffffffffff, B }; struct a { enum e x; };\n")
    assert loads(import_header(header, "wide").text).message("a").fields[0].size == 8


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
