"""The check of a release: what is there passes, and what is missing, of another version or licence is named."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from setup import release


def test_versions_papers_and_licences_are_in_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(release, "OUT", tmp_path)
    assert [*release.versions(), *release.papers(), *release.licences()] == []
    rows = re.findall(r"^\| (\S+) \| .* \| (.+) \| (.+) \|$", (tmp_path / "LICENCES.md").read_text(), re.MULTILINE)
    assert {"numpy", "svelte", "nanobind", "libc++"} <= {name for name, *_ in rows}
    bill = json.loads((tmp_path / "sbom.cdx.json").read_text())
    assert len(bill["components"]) == len(rows) - 1  # without the table's head
    (svelte,) = (one for one in bill["components"] if one["name"] == "svelte")
    assert svelte["purl"] == f"pkg:npm/svelte@{svelte['version']}"


def test_another_version_and_a_missing_paper_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read = release._read
    monkeypatch.setattr(
        release, "_read", lambda name: read(name).replace("0.1.0", "0.2.0") if name.endswith("json") else read(name)
    )
    assert release.versions() == ["console/package.json says 0.2.0, but pyproject.toml 0.1.0"]
    monkeypatch.setattr(release, "PAPERS", (*release.PAPERS, "MISSING.md"))
    assert release.papers() == ["MISSING.md is missing; write it"]


@pytest.mark.parametrize("licence", ["GPL-3.0-or-later", "unknown", "MIT AND LGPL-2.1"])
def test_a_licence_that_is_not_allowed_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, licence: str) -> None:
    monkeypatch.setattr(release, "OUT", tmp_path)
    monkeypatch.setattr(
        release, "page_parts", lambda: iter([release.Part("left-pad", "1.3.0", licence, "in the page", "npm")])
    )
    assert release.licences() == [f"left-pad has the licence {licence}; decide whether it may be here"]
