"""The wheels of `make wheels` on Debian systems that have nothing else, unpacked into folders; two of them for 64-bit
ARM, under an emulator."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tests.shared import ROOT

pytestmark = [
    pytest.mark.live,
    pytest.mark.long,
    pytest.mark.skipif(
        shutil.which("apt-get") is None or os.getuid() != 0, reason="needs root on a Debian-like system"
    ),
]

WHEELS = ROOT / "build" / "wheels"
KEYS = "/usr/share/keyrings/debian-archive-keyring.gpg"
# Of the engine: every format, value and rule, and links under virtual time.
ENGINE_TESTS = (
    *(
        f"tests/test_{name}.py"
        for name in ("against_reference", "codec", "deframing", "field_types", "forms", "header")
    ),
    *(f"tests/test_{name}.py" for name in ("random_formats", "scaled_values", "sequence", "values", "vectors")),
    "tests/link",
)
TEST_PACKAGES = ("pytest", "hypothesis", "crccheck", "jsonschema", "mcap")


@pytest.fixture(scope="module")
def wheels() -> Path:
    """The folder of the wheels. Building takes a quarter of an hour: what is there already is taken."""
    if not list(WHEELS.glob("*aarch64.whl")):
        subprocess.run(["make", "wheels"], cwd=ROOT, check=True)
    return WHEELS


def wheel_of(folder: Path, python: str, processor: str) -> Path:
    tag = "cp311-cp311" if python == "3.11" else "cp312-abi3"
    (found,) = folder.glob(f"*-{tag}-*_{processor}.whl")
    return found


def debian(folder: Path, release: str, processor: str, *packages: str) -> Path:
    """Unpack these packages of Debian, and what they depend on, without installing anything on this computer."""
    root, state = folder / "root", folder / "apt"
    for name in ("lib", "bin", "sbin", "lib64"):
        (root / "usr" / name).mkdir(parents=True)
        (root / name).symlink_to(f"usr/{name}")
    for name in ("lists/partial", "cache/archives/partial"):
        (state / name).mkdir(parents=True)
    (state / "status").touch()
    listed = ["apt-get", "indextargets", "--format", "$(REPO_URI)", "Origin: Debian"]
    archive = subprocess.run(listed, check=True, capture_output=True, text=True).stdout.split()[0]
    (state / "sources.list").write_text(f"deb [signed-by={KEYS}] {archive} {release} main\n")
    settings = {
        "APT::Architecture": processor,
        "APT::Architectures": processor,
        "APT::Sandbox::User": "root",
        "APT::Install-Recommends": "false",
        "Acquire::Languages": "none",
        "Dir::State": state,
        "Dir::State::status": state / "status",
        "Dir::State::lists": state / "lists",
        "Dir::Cache": state / "cache",
        "Dir::Etc::sourcelist": state / "sources.list",
        "Dir::Etc::sourceparts": "/nonexistent",
    }
    apt = ["apt-get", "-qq", *(f"-o{key}={value}" for key, value in settings.items())]
    subprocess.run([*apt, "update"], check=True, stderr=subprocess.DEVNULL)
    subprocess.run([*apt, "--yes", "--download-only", "install", *packages], check=True, stderr=subprocess.DEVNULL)
    for package in (state / "cache" / "archives").glob("*.deb"):
        subprocess.run(["dpkg-deb", "-x", package, root], check=True)
    return root


_IN_ROOT = """
root=$1; wheels=$2; shift 2
mount --make-rprivate /
mkdir -p $root/proc $root/dev $root/tmp $root/root $root/etc/ssl/certs $root/wheels $root/run
mount -t proc proc $root/proc
mount --rbind /dev $root/dev
mount --bind /etc/ssl/certs $root/etc/ssl/certs
mount --bind $wheels $root/wheels
for file in resolv.conf hosts pip.conf; do [ -e /etc/$file ] && cp /etc/$file $root/etc/; done
exec chroot $root /usr/bin/env -i PATH=/usr/bin:/bin HOME=/root LC_ALL=C.UTF-8 "$@"
"""


def in_root(root: Path, wheels: Path, script: str) -> str:
    """Run a script of the shell in the system of this folder. It has this computer's devices and network, no more."""
    pip = [f"{key}={value}" for key, value in os.environ.items() if key.startswith("PIP_") and key != "PIP_FIND_LINKS"]
    unshared = ["unshare", "--mount", "--pid", "--fork", "--mount-proc", "sh", "-c", _IN_ROOT, "sh", root, wheels]
    done = subprocess.run(
        [*unshared, *pip, "sh", "-euc", script], stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_there_is_one_for_each_python_and_each_processor(wheels: Path) -> None:
    for processor in ("x86_64", "aarch64"):
        for python in ("3.11", "3.12"):
            with zipfile.ZipFile(wheel_of(wheels, python, processor)) as archive:
                names = archive.namelist()
                programs = [archive.getinfo(f"wirebond/data/programs/{name}") for name in ("rover", "wire")]
            assert len([name for name in names if name.endswith(".so")]) == 1
            assert "wirebond/console/page/index.html" in names
            assert all(program.external_attr >> 16 & 0o111 for program in programs)


def test_the_demo_and_a_recording_work_without_a_compiler_and_without_node(wheels: Path, tmp_path: Path) -> None:
    root = debian(tmp_path, "bookworm", "amd64", "python3-venv", "libstdc++6", "coreutils", "dash")
    name = wheel_of(wheels, "3.11", "x86_64").name
    shown = in_root(
        root,
        wheels,
        f"""
        for tool in c++ g++ cc gcc clang node cmake; do ! command -v $tool; done
        python3 -m venv /wirebond
        /wirebond/bin/pip install --quiet /wheels/{name}
        cd /root
        /wirebond/bin/wirebond demo --terminal --seconds 3
        protocols=$(/wirebond/bin/wirebond --cmakedir)/../protocols
        /wirebond/bin/wirebond serve $protocols/diffdrive.yaml sim: --record run.mcap --seconds 3
        /wirebond/bin/wirebond info run.mcap
        """,
    )
    assert "building the rover" not in shown
    assert "received" in shown and "0 frames" not in shown.partition("received")[2].splitlines()[0]
    assert "odometry: " in shown.partition("run.mcap")[2]


@pytest.mark.parametrize(("release", "python"), [("bookworm", "3.11"), ("trixie", "3.13")])
def test_the_tests_of_the_engine_pass_on_arm(wheels: Path, release: str, python: str, tmp_path: Path) -> None:
    """On ARM, char is unsigned. Processes and ttys are left out: the emulator has no ttys, and its order of memory is
    this computer's."""
    root = debian(tmp_path, release, "arm64", "python3", "libstdc++6")
    packages = tmp_path / "packages"
    platforms = [f"--platform=manylinux_2_{minor}_aarch64" for minor in (28, 27, 17)]
    pins = (ROOT / "requirements-dev.txt").read_text(encoding="utf-8").split()
    wanted = [pin for pin in pins if pin.partition("==")[0] in TEST_PACKAGES]
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--target", packages, "--only-binary=:all:"]
    wheel = wheel_of(wheels, python, "aarch64")
    subprocess.run(
        [*install, "--implementation=cp", f"--python-version={python}", *platforms, wheel, *wanted], check=True
    )
    import cobs  # noqa: PLC0415 - has no wheel; it is Python alone

    shutil.copytree(Path(cobs.__file__).parent, packages / "cobs")
    emulated = ["qemu-aarch64", "-L", root, root / "usr" / "bin" / f"python{python}"]
    tests = ["-m", "pytest", "-p", "no:cacheprovider", "-o", "faulthandler_timeout=7200"]
    chosen = ["-m", "not long and not live and not timed", *ENGINE_TESTS]
    environment = {**os.environ, "PYTHONPATH": str(packages), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [*emulated, *tests, *chosen], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr
