"""The docstrings of the public surface: each parameter and each error by its name."""

from __future__ import annotations

import ast
import inspect
import textwrap
from pathlib import Path
from typing import Any

import pytest

import wirebond

PACKAGE = Path(wirebond.__file__).parent
PUBLIC = [getattr(wirebond, name) for name in wirebond.__all__]


def functions_of(owner: Any) -> dict[str, Any]:
    """Every public function that is written here, by its name for people."""
    if not inspect.isclass(owner):
        return {owner.__name__: owner}
    return {
        f"{owner.__name__}.{name}": getattr(member, "fget", member)
        for name, member in vars(owner).items()
        if not name.startswith("_") and (inspect.isroutine(member) or isinstance(member, property))
    }


FUNCTIONS = {name: f for owner in PUBLIC for name, f in functions_of(owner).items()}


def raised_in(function: Any) -> set[str]:
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    raised = (node.exc for node in ast.walk(tree) if isinstance(node, ast.Raise))
    return {error.func.id for error in raised if isinstance(error, ast.Call) and isinstance(error.func, ast.Name)}


@pytest.mark.parametrize("owner", [owner for owner in PUBLIC if inspect.isclass(owner)])
def test_every_public_class_says_what_it_is(owner: Any) -> None:
    assert (owner.__doc__ or "").strip()
    assert not (owner.__doc__ or "").startswith(f"{owner.__name__}("), "a dataclass without words of its own"


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_public_function_names_its_parameters_and_its_errors(name: str) -> None:
    function = FUNCTIONS[name]
    text = inspect.getdoc(function) or ""
    assert text.strip(), "no docstring"
    if not inspect.isfunction(function):  # of the engine: its stub has the items
        return
    signature = inspect.signature(function)
    for parameter in list(signature.parameters)[1 if "." in name else 0 :]:
        assert f":param {parameter}:" in text
    for error in raised_in(function):
        assert f":raises {error}:" in text
    kind, _, attribute = name.partition(".")
    is_property = attribute and isinstance(inspect.getattr_static(getattr(wirebond, kind), attribute), property)
    if not is_property and signature.return_annotation not in ("None", None):
        assert ":returns:" in text


def test_every_name_of_the_engines_stub_is_explained() -> None:
    tree = ast.parse((PACKAGE / "_engine.pyi").read_text())
    named = [node for node in ast.walk(tree) if isinstance(node, ast.ClassDef | ast.FunctionDef)]
    missing = [node.name for node in named if not ast.get_docstring(node)]
    assert not missing
