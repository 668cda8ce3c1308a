"""Finds the package's C++ sources and protocol files: next to the installed package, or in the source tree."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent
PAGE = _PACKAGE / "console" / "page"  # the console's page, where it was built
ENGINE_FOR_PAGES = _PACKAGE / "console" / "engine.wasm"  # for a page without a server, where it was built
PROGRAMS = _PACKAGE / "data" / "programs"  # compiled for this machine; only wheels have them


def _find(relative: str) -> Path:
    installed = _PACKAGE / "data" / relative
    if installed.is_dir():
        return installed
    tree = _PACKAGE.parents[2] / relative
    if tree.is_dir():
        return tree
    message = f"the installation is incomplete: {relative} is neither in {installed} nor in {tree}"
    raise FileNotFoundError(message)


def core_include() -> Path:
    """Return the folder that holds ``wirebond/*.hpp``."""
    return _find("core/include")


def port_include(port: str) -> Path:
    """Return the folder that holds ``wirebond/<port>/*.hpp``."""
    return _find(f"ports/{port}/include")


def port_in_c(port: str) -> Path:
    """Return the folder that holds the C files of a port that has some."""
    return _find(f"ports/{port}/c")


def posix_include() -> Path:
    """Return the folder that holds ``wirebond/posix/*.hpp``."""
    return port_include("posix")


def cmake() -> Path:
    """Return the folder that ``find_package(wirebond)`` needs as ``wirebond_DIR``."""
    return _find("cmake")


def protocols() -> Path:
    """Return the folder of the project's own protocol files."""
    return _find("protocols")


def protocol_folders() -> tuple[Path, Path]:
    """Return the folders of the protocol files that come with the package: the project's own, and public formats."""
    return protocols(), protocols() / "contrib"


def protocol_files() -> list[Path]:
    """Return the protocol files that come with the package."""
    return [file for folder in protocol_folders() for file in sorted(folder.glob("*.yaml"))]


def firmware() -> Path:
    """Return the firmwares' sources."""
    return _find("firmware")


def sim() -> Path:
    """Return the C++ sources of the simulator: ``include``, and a folder for each of its programs."""
    return _find("sim")
