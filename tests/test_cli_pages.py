"""The pages name every option of the commands and every rule of the lint, and no other."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from typing import Any

import typer

from tests.shared import ROOT
from wirebond.cli.main import app

PAGES = [path for path in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))] if ".zh." not in path.name]
TEXT = "\n".join(path.read_text(encoding="utf-8") for path in PAGES)
HELP = {"--help"}
CHECKS = ROOT / "python" / "src" / "wirebond" / "analysis" / "check"


def commands(command: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    if not hasattr(command, "commands"):
        yield name, command
        return
    for part, one in command.commands.items():
        yield from commands(one, f"{name} {part}".strip())


EVERY = dict(commands(typer.main.get_command(app)))


def options(command: Any) -> Iterator[list[str]]:
    """The long names of each option."""
    for parameter in command.params:
        if names := [name for name in (*parameter.opts, *parameter.secondary_opts) if name.startswith("--")]:
            yield names


def test_every_option_is_in_a_page() -> None:
    assert len(EVERY) > 25
    missing = [
        (name, names)
        for name, command in EVERY.items()
        for names in options(command)
        if not any(re.search(rf"{re.escape(one)}(?![\w-])", TEXT) for one in names)
    ]
    assert missing == []


def test_every_command_is_in_the_table_of_the_command_line() -> None:
    table = (ROOT / "docs" / "cli.md").read_text(encoding="utf-8").split("## Exit codes")[0]
    assert [name for name in EVERY if f"`{name.split()[0]}`" not in table and name != "schema"] == []


def test_no_page_gives_a_command_an_option_that_it_does_not_have() -> None:
    wrong = []
    for path in PAGES:
        for line in path.read_text(encoding="utf-8").splitlines():
            for found in re.finditer(r"wirebond ([a-z]+)([^`|#]*)", line):
                own = [one for name, one in EVERY.items() if name.split()[0] == found[1]]
                known = HELP.union(*(names for one in own for names in options(one)))
                asked = re.findall(r"(?<![\w-])--[a-z][\w-]*", found[2])
                wrong += [(path.name, found[1], name) for name in asked if own and name not in known]
    assert wrong == []


def rules_of_the_lint() -> Iterator[str]:
    """The first argument of each finding: a text, or a constant of its module."""
    for path in sorted(CHECKS.glob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        texts = {
            target.id: node.value.value
            for node in tree.body
            if isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant)
            for target in node.targets
            if isinstance(target, ast.Name)
        }
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Finding":
                rule = node.args[0]
                yield str(rule.value) if isinstance(rule, ast.Constant) else texts[getattr(rule, "id", "")]


def test_the_page_of_the_lint_has_each_rule_once_and_no_other() -> None:
    page = (ROOT / "docs" / "check.md").read_text(encoding="utf-8").split("## Rules")[1].split("\n## ")[0]
    named = re.findall(r"^\| `([a-z-]+)` \|", page, re.MULTILINE)
    assert sorted(named) == sorted(set(rules_of_the_lint()))
