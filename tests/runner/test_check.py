"""`make check` finds the tests that a change reaches, and the linters for it."""

from __future__ import annotations

from tests.runner.check import linters, reaching

RULES = "tests/architecture/test_waiting_rules.py"


def test_the_nearest_tests_come_first_and_others_do_not_come() -> None:
    found = reaching(["tests/architecture/waiting_rules.py"])
    assert found == [RULES]
    found = reaching(["python/src/wirebond/protocol/model/fields.py", RULES])
    assert found[0] == RULES
    assert len(found) > 100
    assert not [file for file in found if not file.startswith("tests/")]


def test_a_conftest_reaches_its_folder() -> None:
    found = reaching(["tests/server/conftest.py"])
    assert "tests/server/test_control.py" in found
    assert RULES not in found
    found = reaching(["tests/patient_servers.py"])  # conftests import it
    assert {"tests/server/test_control.py", "tests/console/test_page.py"} <= set(found)
    assert RULES not in found
    assert RULES in reaching(["conftest.py"])


def test_the_engine_reaches_its_importers_and_a_file_those_that_name_it() -> None:
    assert len(reaching(["core/include/wirebond/bytes.hpp"])) > 100
    assert "tests/recording/test_replay.py" in reaching(["protocols/diffdrive.yaml"])


def test_each_linter_sees_what_is_its_own() -> None:
    assert linters(["README.md"]) == {}
    assert linters(["console/src/link.ts"]).keys() == {"page", "tests of the page"}
    python = linters(["tests/runner/check.py"])
    assert python["ruff"][-1] == "tests/runner/check.py"
    assert {"ruff", "ruff format", "mypy", "waiting", "dependencies"} == python.keys()
    assert linters(["core/include/wirebond/bytes.hpp"])["clang-format"][-1] == "core/include/wirebond/bytes.hpp"
