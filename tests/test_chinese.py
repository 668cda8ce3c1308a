"""Sentences of the server, and the protocol's document, in Chinese. Nobody's own words are changed."""

from __future__ import annotations

import ast
import errno
import itertools
import json
import os
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

import wirebond
from tests.shared import loaded
from wirebond.analysis.explain.verdict import Cause
from wirebond.chinese import SENTENCES, Table, chinese, read_pairs, text_of, with_chinese
from wirebond.codec import Codec
from wirebond.generate.doc import chinese_document, markdown
from wirebond.generate.doc.chinese import own_words
from wirebond.protocol import loads
from wirebond.recording.writer import full_disk_sentence, unsafe_sentence

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "python" / "src" / "wirebond"
# What raises or refuses in these is shown by the page.
SHOWN = ["console/*.py", "server/c*.py", "server/recording*.py", "server/stop.py", "history/history.py", "jobs/*.py"]
NOT_SHOWN = re.compile(
    "the console's token is part|only the console's own page|is not this console|records of frames|the first message "
    "must|at once; close a recording|expected 1024 to|recordings of all clients|no recording with the number|JSON "
    "object of at|a page is for a protocol that|the console's page, or its engine for browsers"
)  # for programs and the command line, or before there is a page
REFUSING = {"RefusedError", "refuse", "refusal", "_tell_error"}
PAGE = ROOT / "console" / "src" / "page"
PAGE_TABLES = (*SENTENCES, "page")
NOT_SHOWN_BY_PAGE = {"it is not there"}  # caught where it is thrown
FILES = sorted((ROOT / "protocols").rglob("*.yaml"))
# Words of the notation, which Chinese documents have, too.
NOTATION = {"rest", "stuffing", "be", "true", "false", "poly", "init", "refin", "refout", "xorout", "wire", "wi"}


def sentences(source: str) -> Iterator[str]:
    """Those that are raised or told here, with a word at each place that is filled in."""
    for node in ast.walk(ast.parse(source)):
        called = node.func if isinstance(node, ast.Call) else None
        name = getattr(called, "id", getattr(called, "attr", ""))
        if isinstance(node, ast.Raise) or name in REFUSING:
            yield from texts(node)


def texts(node: ast.AST) -> Iterator[str]:
    if isinstance(node, ast.JoinedStr):
        yield "".join(str(part.value) if isinstance(part, ast.Constant) else "X1" for part in node.values)
        return
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    for child in ast.iter_child_nodes(node):
        yield from texts(child)


def protocols() -> list[tuple[str, Codec]]:
    found = []
    for path in FILES:
        if "protocol:" in path.read_text(encoding="utf-8"):
            found.append((path.stem, loaded(path)))
    return found


def test_each_sentence_for_the_page_has_a_chinese_one() -> None:
    said = {text for pattern in SHOWN for path in PACKAGE.glob(pattern) for text in sentences(path.read_text("utf-8"))}
    said = {text for text in said if " " in text.strip() and not NOT_SHOWN.search(text)}
    assert len(said) > 40  # it finds them
    assert sorted(text for text in said if chinese(text) is None) == []


def sentences_of_page(source: str) -> Iterator[str]:
    """Those that the worker of a page without a server throws."""
    literal = re.compile(r'"((?:[^"\\]|\\.)*)"|`((?:[^`\\]|\\.)*)`')
    for call in re.finditer(r"(new \w*Error|super|goDown)\(|(why|text) = ", source):
        has_bracket = call[0].endswith("(")
        depth, at = int(has_bracket), call.end()
        while depth > 0 or not (has_bracket or source.startswith(";\n", at)):
            depth += {"(": 1, ")": -1}.get(source[at], 0)
            at += 1
        text, end = "", call.end()
        for found in literal.finditer(source, call.end(), at):
            if source[end : found.start()].strip() != "+":
                yield text
                text = ""
            text += re.sub(r"\$\{[^{}]*\}", "X1", (found[1] or found[2] or "").replace("\\`", "`"))
            end = found.end()
        yield text


def test_each_sentence_of_a_page_without_a_server_has_a_chinese_one() -> None:
    table = Table(*SENTENCES, "page")
    said = {text for path in PAGE.glob("*.ts") for text in sentences_of_page(path.read_text("utf-8"))}
    said = {text for text in said if len(text.split()) > 2}
    assert len(said) > 30  # it finds them
    english = {text: re.sub("`[^`]*`|X1|hello", "", table.find(text) or text) for text in said - NOT_SHOWN_BY_PAGE}
    assert {text: left for text, left in english.items() if re.search(r"\b[a-z]{3,}", left)} == {}


def word_pairs(text: str) -> list[tuple[str, str]]:
    words = re.findall("[A-Za-z']+", text)
    return list(itertools.pairwise(words))


def test_each_sentence_in_the_tables_is_one_that_the_code_still_says() -> None:
    said: set[tuple[str, str]] = set()
    for path in PACKAGE.rglob("*.py"):
        said.update(pair for text in texts(ast.parse(path.read_text("utf-8"))) for pair in word_pairs(text))
    for path in [*(ROOT / "core" / "include").rglob("*.h*"), *(ROOT / "engine").rglob("*.?pp"), *PAGE.glob("*.ts")]:
        said.update(word_pairs(re.sub(r'"\s*\+?\s*"|\$\{[^{}]*\}', "", path.read_text("utf-8"))))
    old = []
    for table in sorted((PACKAGE / "translations" / "zh").glob("*.txt")):
        for pair in [] if table.stem == "system" else read_pairs(table.read_text("utf-8")):
            own = [found for literal in pair.literals for found in word_pairs(literal)]
            # Sentences are put together from parts, so a few pairs of words are in no text of the code.
            if len(own) >= 5 and sum(found in said for found in own) < 0.6 * len(own):
                old.append((table.name, "{}".join(pair.literals)))
    assert old == []


def test_a_port_that_cannot_be_opened_says_why_in_chinese(tmp_path: Path) -> None:
    file = tmp_path / "no port"
    file.write_text("")
    for port in (str(file), str(tmp_path), str(tmp_path / "missing"), "tcp://127.0.0.1:1"):
        with pytest.raises(wirebond.PortError) as raised:
            wirebond.open(ROOT / "protocols" / "diffdrive.yaml", port).close()
        told = chinese(str(raised.value))
        assert told is not None and re.search("[\u4e00-\u9fff]", told) and port.removeprefix("tcp://") in told


@pytest.mark.parametrize(
    ("message", "fields"),
    [
        ("velocity", {"linear": 9.0}),
        ("velocity", {"linear": float("nan")}),
        ("velocity", {"linear": "fast"}),
        ("velocity", {"linear": 10**400}),
        ("velocity", {"wheel": 1}),
        ("odometry", {"left_ticks": 1 << 40, "right_ticks": 0}),
        ("odometry", {}),
        ("parameter", {"name": "nothing", "value": 0}),
        ("status", {"battery": 12.0, "errors": ["nothing"], "state": []}),
        ("status", {"battery": 12.0, "errors": 0.5, "state": []}),
    ],
)
def test_a_value_that_is_refused_is_refused_in_chinese(message: str, fields: dict[str, object]) -> None:
    codec = loaded(ROOT / "protocols" / "diffdrive.yaml")
    with pytest.raises(wirebond.MessageError) as raised:
        codec.encode(message, fields)
    assert chinese(str(raised.value)) is not None, str(raised.value)


CHECKS = """\
wirebond: 1
protocol: checks
frame:
  - magic: 0x5A
  - id: u8
  - {bits: u8, fields: {parity: {bits: 4, check: {type: sum8, over: magic..bits}, from_bit: 4}, counter: 4}}
  - check: {type: sum, width: 16, unit: 2, odd: xor, modulo: 9999, plus: 3, mask: 0x7FFF, bcd: true}
  - payload: 4
  - name: last
    check:
      {type: sum, width: 8, unit: 4, carry: end_around, over: [id, payload], avoid: {values: 0..9, plus: 10}}
messages: {data: {id: 1, sender: mcu, fields: {data: u32}}}
"""


@pytest.mark.parametrize(
    ("name", "codec"), [pytest.param(*each, id=each[0]) for each in [*protocols(), ("checks", Codec(loads(CHECKS)))]]
)
def test_the_document_of_a_protocol_is_chinese_but_for_the_words_of_its_file(name: str, codec: Codec) -> None:
    del name
    own = set(re.findall("[A-Za-z]{2,}", codec.model.text)) | NOTATION
    left = []
    is_code = False
    for line in chinese_document(codec).splitlines():
        is_code ^= line.startswith("```")
        words = re.findall(
            "(?<![0-9A-Za-z])[A-Za-z]{2,}", re.sub("`[^`]*`|0x[0-9A-F]+|[a-z][0-9]+be|[0-9.]+ [mu]?s", "", line)
        )
        known = own | {"ID", "IEEE", "COBS", "Consistent", "Overhead", "Byte", "Stuffing", "xor", "crc", "sum", "hello"}
        if not is_code and not line.startswith("```") and set(words) - known:
            left.append(line)
    assert left == []


def test_both_documents_have_the_same_lines_of_code_and_the_same_rows() -> None:
    for _, codec in protocols():
        english, translated = markdown(codec).splitlines(), chinese_document(codec).splitlines()
        for kind in ("|", "#", "```"):
            assert [line.startswith(kind) for line in english].count(True) == len(
                [line for line in translated if line.startswith(kind)]
            )
        assert {row.count("|") for row in english} == {row.count("|") for row in translated}


def test_the_files_own_texts_are_not_translated() -> None:
    text = (ROOT / "protocols" / "diffdrive.yaml").read_text(encoding="utf-8")
    own = "up to 3 of them or 2 of the base, always 1"
    codec = Codec(loads(re.sub("(description: ).*", rf"\1{own}", text, count=1)))
    assert own in own_words(codec.model)
    assert own in chinese_document(codec)


def test_a_sentence_within_a_sentence_is_translated_and_names_are_not() -> None:
    why = "there is no port is empty; plug it in, or look for its name with `ls /dev/tty*`"
    assert chinese(f"move was not sent: {why}") == (
        "move 没有发送：没有串口 is empty；请插上设备，或用 `ls /dev/tty*` 查看名称"  # noqa: RUF001
    )
    assert chinese("the battery is low, said the firmware") is None


@pytest.mark.live  # it runs Node
def test_a_page_without_a_server_finds_the_same_chinese() -> None:
    table = Table(*PAGE_TABLES)
    said = sorted(variants(table))
    assert len(said) > 2000
    program = """
        import { readFileSync } from "node:fs";
        const [root] = process.argv.slice(1);
        const ts = (await import(`${root}/console/node_modules/typescript/lib/typescript.js`)).default;
        const source = readFileSync(`${root}/console/src/chinese.ts`, "utf8");
        const options = { target: ts.ScriptTarget.ESNext, module: ts.ModuleKind.ESNext };
        const { outputText } = ts.transpileModule(source, { compilerOptions: options });
        const { Chinese } = await import(`data:text/javascript,${encodeURIComponent(outputText)}`);
        const { tables, said } = JSON.parse(readFileSync(0, "utf8"));
        const page = new Chinese(tables);
        console.log(JSON.stringify(said.map((text) => [page.find(text), page.find(text)])));
    """
    done = subprocess.run(
        ["node", "--input-type=module", "-e", program, str(ROOT)],
        input=json.dumps({"tables": text_of(*PAGE_TABLES), "said": said}),
        capture_output=True,
        text=True,
        check=True,
    )
    found = json.loads(done.stdout)
    expected = [table.find(text) for text in said]
    assert found == [[each, each] for each in expected]  # the second answer comes from its memory
    assert expected.count(None) < len(said) / 2 < len({each for each in expected if each})


def variants(table: Table) -> set[str]:
    """Return sentences of the tables with several values, one within another, cut short, or with a wrong number."""
    inner = next(pair.literals[0] for pair in table.pairs if not pair.names)
    found = {"", "a sentence without a pair", "7", inner + inner}
    for pair in table.pairs:
        for values in (("7",), ("two words",), (inner,), ("\u00b2",), ("7", inner), (inner, "x 7"), ("",)):
            parts = itertools.chain(
                *itertools.zip_longest(pair.literals, itertools.islice(itertools.cycle(values), len(pair.names)))
            )
            text = "".join(part or "" for part in parts)
            found |= {text, text[:-1], f" {text}"}
    return found


def test_a_twin_is_beside_each_sentence_that_has_one() -> None:
    told = {"why": "it is being opened", "port": "it is being opened", "problems": ["its length is wrong", "own words"]}
    assert with_chinese(told, "why", "problems", "missing") == {
        **told,
        "why_zh": "正在打开",
        "problems_zh": ["长度错误", "own words"],
    }
    assert with_chinese({"why": "own words"}, "why") == {"why": "own words"}


def test_a_long_text_of_somebody_else_costs_nothing() -> None:
    assert chinese("a" * 3000 + "; see docs/console-api.md") is None
    hostile = "payload of " * 150 + "x"
    assert chinese(hostile) is None


@pytest.mark.parametrize("wrong", ["one line", "a {x}\nb {y}", "a {x}{y}\nb", "a {x} b {x}\nc {x}", "a\nb\nc"])
def test_a_table_that_is_wrong_is_refused(wrong: str) -> None:
    with pytest.raises(ValueError, match="pair"):
        read_pairs(wrong)


def test_no_english_sentence_appears_twice() -> None:
    for names in (("link", "server", "values", "recordings", "system"), ("document", "explained"), ("columns",)):
        table = Table(*names)
        english = [tuple(pair.literals) for pair in table.pairs]
        assert sorted({one for one in english if english.count(one) > 1}) == []


def test_each_reason_for_which_a_repeated_message_ends_has_words_in_both_languages() -> None:
    folders = (ROOT / "engine", PACKAGE.parents[1] / "native")
    sources = [path for folder in folders for path in folder.rglob("*.[ch]pp")]
    calls = "\n".join(path.read_text("utf-8") for path in sources)
    reasons = set(re.findall(r'note_changes\([^;]*"(\w+)"', calls)) | {"ended"}
    assert reasons >= {"expired", "stopped", "closed"}
    for language in ("en", "zh"):
        text = (ROOT / "console" / "src" / "texts" / f"{language}.ts").read_text("utf-8")
        words = re.search(r"whyEnded: \{([^}]*)\}", text)
        assert words is not None and reasons <= set(re.findall(r"(\w+):", words[1]))


def test_each_cause_of_a_discard_has_words_in_both_languages() -> None:
    causes = {cause.value for cause in Cause} - {""}
    for language in ("en", "zh"):
        text = (ROOT / "console" / "src" / "texts" / f"{language}.ts").read_text("utf-8")
        words = re.search(r"causes: \{([^}]*)\}", text)
        assert words is not None and causes == set(re.findall(r"(\w+): ", words[1]))


def test_a_recording_that_ends_early_says_why_in_chinese(tmp_path: Path) -> None:
    unsafe = "Its first 4096 bytes, up to 1.5 s, are safe on the disk; the 300 bytes after them are not"
    for number in (errno.ENOSPC, errno.EFBIG, errno.EIO):
        error = OSError(number, os.strerror(number))
        for said in (full_disk_sentence(error, tmp_path), unsafe_sentence(error, tmp_path, unsafe)):
            told = chinese(said)
            assert told is not None and not re.search("[a-z]{3} [a-z]{3}", told), told
        more = chinese(f"{full_disk_sentence(error, tmp_path)}. {unsafe}")
        assert more is not None and "4096 字节（到 1.5 s 为止）已安全写入磁盘" in more  # noqa: RUF001
