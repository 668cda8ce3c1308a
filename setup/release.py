"""Put the files of a release into build/release, and check that they can be published.

    .venv/bin/python setup/release.py [--without wheels,site]

Each step prints one line. The exit code is 1 if a step has found a problem. `make release-check` builds what it needs
first.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import distribution
from pathlib import Path

from cyclonedx.model.bom import Bom
from cyclonedx.model.component import Component, ComponentType
from cyclonedx.model.license import DisjunctiveLicense, LicenseExpression
from cyclonedx.output.json import JsonV1Dot6
from packageurl import PackageURL
from packaging.requirements import Requirement
from packaging.utils import parse_wheel_filename

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "build" / "release"
WHEELS = ROOT / "build" / "wheels"
SITE = ROOT / "build" / "site"
TAGS = (
    "cp311-cp311-manylinux_2_17_x86_64",
    "cp311-cp311-manylinux_2_17_aarch64",
    "cp312-abi3-manylinux_2_17_x86_64",
    "cp312-abi3-manylinux_2_17_aarch64",
    "cp312-abi3-win_amd64",
    "cp312-abi3-macosx_11_0_x86_64",
    "cp312-abi3-macosx_11_0_arm64",
)  # that the wheels must have
PAPERS = ("LICENSE", "README.md", "CHANGELOG.md", "SECURITY.md", "CODE_OF_CONDUCT.md", "CONTRIBUTING.md")
# What packages call their licence in other words than SPDX does.
SPDX = {
    "BSD": "BSD-3-Clause", "BSD License": "BSD-3-Clause", "MIT License": "MIT", "ISC License": "ISC",
    "ISC License (ISCL)": "ISC", "Apache": "Apache-2.0",
}  # fmt: skip
ALLOWED = {
    "0BSD", "Apache-2.0", "Apache-2.0 WITH LLVM-exception", "BSD-2-Clause", "BSD-3-Clause", "CC0-1.0", "ISC", "MIT",
    "PSF-2.0", "Zlib",
}  # fmt: skip


@dataclass(frozen=True)
class Part:
    """Something of others that a release contains or installs.

    :ivar licence: an SPDX expression.
    :ivar place: how it gets to a user.
    """

    name: str
    version: str
    licence: str
    place: str
    kind: str  # of its package URL

    @property
    def is_allowed(self) -> bool:
        return all(word in ALLOWED for word in re.split(r" (?:AND|OR) ", self.licence.strip("()")))


def python_parts(name: str = "wirebond", seen: set[str] | None = None) -> Iterator[Part]:
    """Yield the packages that pip installs with Wirebond, as they are installed here."""
    seen = set() if seen is None else seen
    for text in distribution(name).requires or []:
        required = Requirement(text)
        key = required.name.lower().replace("_", "-")
        if key in seen or (required.marker is not None and not required.marker.evaluate({"extra": ""})):
            continue
        seen.add(key)
        found = distribution(key)
        about = found.metadata
        classes = [text for text in about.get_all("Classifier", []) if text.startswith("License")]
        words = [about.get("License-Expression"), *classes, about.get("License")]
        licence = next((word.split(" :: ")[-1] for word in words if word), "unknown")
        yield Part(about["Name"], found.version, SPDX.get(licence, licence), "installed by pip", "pypi")
        yield from python_parts(key, seen)


def page_parts() -> Iterator[Part]:
    """Yield the packages whose code is in the console's page, and in the page without a server."""
    packages = json.loads((ROOT / "console" / "package-lock.json").read_text(encoding="utf-8"))["packages"]
    for path, found in packages.items():
        name = path.removeprefix("node_modules/")
        if path and (not found.get("dev") or name == "svelte"):
            licence = found.get("license", "unknown")
            yield Part(name, found["version"], SPDX.get(licence, licence), "in the page", "npm")


def linked_parts() -> Iterator[Part]:
    """Yield what is linked into the engine of a wheel, with the versions of the requirements."""
    required = _read("requirements.txt") + _read("requirements-dev.txt")
    pins = dict(re.findall(r"^([\w-]+)==([\w.]+)", required, re.MULTILINE))
    place = "in the wheel's engine"
    yield Part("nanobind", pins["nanobind"], "BSD-3-Clause", place, "pypi")
    yield Part("robin-map", f"of nanobind {pins['nanobind']}", "MIT", place, "generic")
    for name in ("libc++", "compiler-rt"):
        yield Part(name, f"of ziglang {pins['ziglang']}", "Apache-2.0 WITH LLVM-exception", place, "generic")


def _read(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def version() -> str:
    """Return the version that this release has."""
    (found,) = re.findall(r'^version = "(.+)"$', _read("pyproject.toml"), re.MULTILINE)
    return str(found)


def versions() -> list[str]:
    """Compare the versions in all files and the changelog."""
    places = {
        "python/src/wirebond/__init__.py": r'__version__ = "(.+)"',
        "console/package.json": r'"version": "(.+)"',
        "ros2/wirebond_ros/package.xml": r"<version>(.+)</version>",
        "ros2/wirebond_ros/setup.py": r'version="(.+)"',
    }
    found = {name: re.findall(pattern, _read(name))[0] for name, pattern in places.items()}
    own = version()
    wrong = [f"{name} says {other}, but pyproject.toml {own}" for name, other in found.items() if other != own]
    if not re.search(rf"^## \[(?:{re.escape(version())}|Unreleased)\]", _read("CHANGELOG.md"), re.MULTILINE):
        wrong.append(f"CHANGELOG.md has no section {version()}; name the one that is released")
    return wrong


def papers() -> list[str]:
    """Look for licence, policies and forms."""
    forms = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"))
    asking = [form for form in forms if "wirebond doctor --json" in form.read_text(encoding="utf-8")]
    missing = [name for name in PAPERS if not (ROOT / name).is_file()]
    wrong = [f"{name} is missing; write it" for name in missing]
    return wrong if asking else [*wrong, "no form for issues asks for `wirebond doctor --json`"]


def source() -> list[str]:
    """Make the source package; everything must be committed."""
    changed = subprocess.run(
        ["git", "status", "--porcelain"],  # noqa: S607 - the git of this computer
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    code = f"from scikit_build_core.build import build_sdist; build_sdist({str(OUT)!r})"
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, capture_output=True)
    name = f"wirebond-{version()}.tar.gz"
    wrong = [] if (OUT / name).is_file() else [f"{name} was not written"]
    return wrong + [f"uncommitted: {line.strip()}; commit it, or take it away" for line in changed.splitlines()[:5]]


def wheels() -> list[str]:
    """Take a wheel for each kind of computer, of this version."""
    found = sorted(WHEELS.glob(f"wirebond-{version()}-*.whl"))
    for path in found:
        shutil.copy(path, OUT)
    tags = {str(tag) for path in found for tag in parse_wheel_filename(path.name)[3]}
    return [f"no wheel for {tag}; run `make wheels`" for tag in TAGS if tag not in tags]


def site() -> list[str]:
    """Pack the documentation into one archive."""
    if not (SITE / "index.html").is_file():
        return ["build/site is not there; run `make docs`"]
    _zip(SITE, f"wirebond-docs-{version()}")
    return []


def ros_package() -> list[str]:
    """Pack the ROS package `wirebond_ros`, as committed."""
    target = OUT / f"wirebond_ros-{version()}.zip"
    options = ["--format=zip", f"--output={target}", "--prefix=wirebond_ros/"]
    command = ["git", "archive", *options, "HEAD:ros2/wirebond_ros"]
    subprocess.run(command, cwd=ROOT, check=True)
    names = zipfile.ZipFile(target).namelist()
    return [f"{name} is not in it" for name in ("package.xml", "setup.py") if f"wirebond_ros/{name}" not in names]


def arduino_library() -> list[str]:
    """Pack a library for Arduino, made from the diffdrive protocol as an example."""
    folder = OUT / "wirebond_diffdrive"
    wirebond = str(Path(sys.executable).with_name("wirebond"))
    command = [wirebond, "gen", "protocols/diffdrive.yaml", "--port", "arduino", "--out", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    found = (folder / "library.properties").read_text(encoding="utf-8")
    keys = ("name", "version", "author", "maintainer", "sentence", "paragraph", "category", "url", "architectures")
    wrong = [f"library.properties has no {key}" for key in keys if not re.search(rf"^{key}=.+$", found, re.MULTILINE)]
    _zip(folder, f"wirebond_diffdrive-arduino-{version()}")
    shutil.rmtree(folder)
    return wrong


def licences() -> list[str]:
    """List the parts of others and their licences, also as a bill of materials (CycloneDX)."""
    parts = sorted({*python_parts(), *page_parts(), *linked_parts()}, key=lambda part: (part.place, part.name.lower()))
    rows = [f"| {part.name} | {part.version} | {part.licence} | {part.place} |" for part in parts]
    begin = "# Licences\n\nWirebond has the MIT licence. It contains or installs:\n\n"
    table = "\n".join(["| part | version | licence | |", "| --- | --- | --- | --- |", *rows])
    (OUT / "LICENCES.md").write_text(f"{begin}{table}\n", encoding="utf-8")
    (OUT / "sbom.cdx.json").write_text(bill(parts), encoding="utf-8")
    unknown = [part for part in parts if not part.is_allowed]
    return [f"{part.name} has the licence {part.licence}; decide whether it may be here" for part in unknown]


def bill(parts: list[Part]) -> str:
    """Return the bill of materials in CycloneDX's JSON."""
    made = Bom()
    root = made.metadata.component = Component(name="wirebond", version=version(), type=ComponentType.LIBRARY)
    for part in parts:
        is_one = " " not in part.licence
        group, _, name = part.name.rpartition("/")
        url = PackageURL(part.kind, group or None, name, part.version) if " " not in part.version else None
        component = Component(
            name=part.name,
            version=part.version,
            type=ComponentType.LIBRARY,
            licenses=[DisjunctiveLicense(id=part.licence) if is_one else LicenseExpression(part.licence)],
            purl=url,
            bom_ref=f"{part.kind}:{part.name}",
        )
        made.components.add(component)
        made.register_dependency(root, [component])
    return JsonV1Dot6(made).output_as_string(indent=2)


def _zip(folder: Path, name: str) -> None:
    shutil.make_archive(str(OUT / name), "zip", folder.parent, folder.name)


STEPS: dict[str, Callable[[], list[str]]] = {
    "versions": versions,
    "papers": papers,
    "source": source,
    "wheels": wheels,
    "site": site,
    "ros": ros_package,
    "arduino": arduino_library,
    "licences": licences,
}


def main() -> int:
    """Run all steps but those that are left out."""
    parser = argparse.ArgumentParser(description="Check a release, and put its files into build/release.")
    parser.add_argument("--without", default="", metavar="STEP,…", help=f"leave out: {', '.join(STEPS)}")
    left_out = set(filter(None, parser.parse_args().without.split(",")))
    if unknown := left_out - STEPS.keys():
        parser.error(f"there is no step {', '.join(sorted(unknown))}; steps are {', '.join(STEPS)}")
    shutil.rmtree(OUT, ignore_errors=True)
    OUT.mkdir(parents=True)
    failed = False
    for name, step in STEPS.items():
        if name in left_out:
            print(f"left out  {name}")
            continue
        problems = step()
        print(f"{'problem' if problems else 'ok':<9} {name:<9} {(step.__doc__ or '').splitlines()[0]}")
        for problem in problems:
            print(f"          {problem}")
        failed |= bool(problems)
    print(f"{OUT.relative_to(ROOT)}: {len(list(OUT.iterdir()))} files")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
