"""The Chinese pages follow the English ones: the same headings, code, tables, lists and links, in the same order."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.test_documentation import anchors

ROOT = Path(__file__).resolve().parents[1]
CHINESE = [ROOT / "README.zh.md", *sorted((ROOT / "docs").glob("*.zh.md"))]
CODE = re.compile(r"^```.*?^```$|^    .*$", re.MULTILINE | re.DOTALL)


def english(page: Path) -> Path:
    return page.with_name(page.name.replace(".zh.md", ".md"))


def shape(text: str) -> list[str]:
    """Return the page's structure, without its words: code as it is, and the kind of every other block's first line."""
    found: list[str] = []
    kinds = {"#": r"(#+) ", "|": r"\|", "-": r"- ", "1": r"\d+\. ", "**": r"\*\*"}
    one_line = re.sub(
        r"^```.*?^```$",
        lambda block: f"\0{block[0]}".replace("\n", "\1"),
        text,
        flags=re.MULTILINE | re.DOTALL,
    )
    for line in one_line.splitlines():
        if line.startswith(("\0", "    ")):
            found.append(line)
        for kind, start in kinds.items():
            if match := re.match(start, line):
                found.append(match[1] if kind == "#" else kind)
    return found


def links(text: str) -> list[str]:
    """Return the targets of all links, without those to the page in the other language."""
    plain = CODE.sub("", text).replace(".zh.md", ".md")
    return [to for to in re.findall(r"\]\(([^)\s]+)\)", plain) if to != "README.md"]


def test_readme_start_and_console_are_there() -> None:
    names = {page.name for page in CHINESE}
    assert names >= {"README.zh.md", "start.zh.md", "console.zh.md"}
    assert {f"{page.stem}.zh.md" for page in (ROOT / "docs").glob("start*.md") if ".zh" not in page.name} <= names


@pytest.mark.parametrize("page", CHINESE, ids=lambda page: page.name)
def test_a_page_has_the_structure_and_the_links_of_the_english_one(page: Path) -> None:
    ours, theirs = page.read_text(encoding="utf-8"), english(page).read_text(encoding="utf-8")
    assert shape(ours) == shape(theirs)
    assert sorted(links(ours)) == sorted(links(theirs))
    assert len(re.findall("[\u4e00-\u9fff]", ours)) > len(CODE.sub("", theirs)) / 8  # it is translated


@pytest.mark.parametrize("page", CHINESE, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for to in re.findall(r"\]\(([^)\s]+)\)", CODE.sub("", page.read_text(encoding="utf-8"))):
        path, _, anchor = to.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), to
        assert not anchor or anchor in anchors(target), to
        is_translated = target.suffix == ".md" and target.with_suffix(".zh.md") in CHINESE
        assert target == english(page) or not is_translated, f"{to} is there in Chinese"


def test_figures_are_the_english_ones() -> None:
    rows = re.compile(r"^\| `\w+` .*make bench.*$", re.MULTILINE)
    texts = [(ROOT / name).read_text(encoding="utf-8") for name in ("README.md", "README.zh.md")]
    assert rows.findall(texts[0]) == rows.findall(texts[1]) != []
