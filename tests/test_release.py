"""The check of a release: what is there passes, and what is missing, of another version or licence is named."""

from __future__ import annotations

import importlib
import json
import platform
import re
import sys
import zipfile
from pathlib import Path

import pytest
from setup import release

from tests.shared import ROOT


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


# As auditwheel and the builds for Windows and macOS name them.
WHEELS = (
    "cp311-cp311-manylinux2014_x86_64.manylinux_2_17_x86_64",
    "cp311-cp311-manylinux2014_aarch64.manylinux_2_17_aarch64",
    "cp312-abi3-manylinux2014_x86_64.manylinux_2_17_x86_64",
    "cp312-abi3-manylinux2014_aarch64.manylinux_2_17_aarch64",
    "cp312-abi3-win_amd64",
    "cp312-abi3-macosx_11_0_x86_64",
    "cp312-abi3-macosx_11_0_arm64",
)


def test_a_missing_wheel_is_named_and_the_others_are_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made, out = tmp_path / "wheels", tmp_path / "release"
    made.mkdir()
    out.mkdir()
    monkeypatch.setattr(release, "WHEELS", made)
    monkeypatch.setattr(release, "OUT", out)
    files = [made / f"wirebond-{release.version()}-{tag}.whl" for tag in WHEELS]
    for path in files:
        path.touch()
    assert release.wheels() == []
    assert {path.name for path in out.iterdir()} == {path.name for path in files}
    files[3].rename(made / "wirebond-0.0.9-cp312-abi3-manylinux2014_aarch64.manylinux_2_17_aarch64.whl")
    assert release.wheels() == ["no wheel for cp312-abi3-manylinux_2_17_aarch64; run `make wheels`"]


@pytest.mark.live
def test_a_wheel_is_audited_where_no_virtual_environment_is_active(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", "/usr/bin:/bin")  # as in `make wheels` from a fresh shell
    monkeypatch.syspath_prepend(ROOT / "setup")
    wheels = importlib.import_module("wheels")
    # The smallest wheel with something to audit: an extension module of this Python.
    processor, this = platform.machine(), f"cp3{sys.version_info.minor}"
    wheel = tmp_path / f"small-1-{this}-{this}-linux_{processor}.whl"
    (library,) = Path(release.distribution("numpy").locate_file("numpy/random")).glob("_mt19937.*.so")
    with zipfile.ZipFile(wheel, "w") as archive:
        archive.write(library, "small.so")
        archive.writestr("small-1.dist-info/METADATA", "Metadata-Version: 2.1\nName: small\nVersion: 1\n")
        archive.writestr(
            "small-1.dist-info/WHEEL",
            f"Wheel-Version: 1.0\nRoot-Is-Purelib: false\nTag: {this}-{this}-linux_{processor}\n",
        )
        archive.writestr("small-1.dist-info/RECORD", "small.so,,\n")
    out = tmp_path / "out"
    out.mkdir()
    assert re.search(r"-manylinux\w*_" + processor, wheels.audited(wheel, out).name)
