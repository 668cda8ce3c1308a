"""Every refused file of these tests is told what to do."""

from __future__ import annotations

import pytest

from wirebond.protocol.problems import Place, Problems


@pytest.fixture(autouse=True)
def every_problem_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    """A sentence says what is wrong, and behind a semicolon what to write."""
    add = Problems.add

    def checked(self: Problems, place: Place, sentence: str) -> None:
        assert "; " in sentence, sentence
        add(self, place, sentence)

    monkeypatch.setattr(Problems, "add", checked)
