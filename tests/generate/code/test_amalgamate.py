"""Amalgamated code: one file that needs no other, and does what the folder does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from wirebond.generate.code import generate_c, generate_cpp
from wirebond.generate.code.amalgamate import amalgamated
from wirebond.protocol.model import Protocol

pytestmark = pytest.mark.live

Shell = Callable[[list[str]], str]

USE = """
#include "diffdrive.hpp"
#include "pid_tuner.hpp"

#include <cstdio>

struct Robot {
  void on(const diffdrive::Velocity& velocity) { std::printf("%g\\n", double(velocity.linear)); }
};

int main() {
  Robot robot;
  diffdrive::Receiver<diffdrive::FromHost> receiver;
  std::uint8_t frame[diffdrive::Velocity::Info::max_frame_bytes];
  std::size_t size = 0;
  if (encode(diffdrive::Velocity{0.5F, 0.0F}, frame, sizeof frame, size) != wirebond::Status::ok) return 1;
  receiver.feed(frame, size, 0, robot);
  return encode(pid_tuner::Pid{}, frame, 0, size) == wirebond::Status::too_small ? 0 : 2;
}
"""


def of_name(protocols: list[Protocol], name: str) -> Protocol:
    return next(p for p in protocols if p.name == name)


def test_two_headers_work_together_and_need_no_folder(
    protocols: list[Protocol], strict: list[str], shell: Shell, tmp_path: Path
) -> None:
    for name in ("diffdrive", "pid_tuner"):
        assert generate_cpp(of_name(protocols, name), tmp_path, amalgamate=True) == [tmp_path / f"{name}.hpp"]
    (tmp_path / "use.cpp").write_text(USE, encoding="utf-8")
    program = tmp_path / "use"
    quick = ["-O0", "-DWIREBOND_INLINE=inline", "-DWIREBOND_INLINE_LAMBDA="]
    shell(["g++", *strict, *quick, str(tmp_path / "use.cpp"), "-o", str(program)])
    assert shell([str(program)]) == "0.5\n"


@pytest.mark.parametrize("name", ["native", "shapes"])
def test_c_is_headers_and_sources_alone(
    name: str, protocols: list[Protocol], strict: list[str], shell: Shell, tmp_path: Path
) -> None:
    files = generate_c(of_name(protocols, name), tmp_path, amalgamate=True)
    assert [path.name for path in files] == [f"{name}.cpp", f"{name}.h", f"{name}_link.cpp", f"{name}_link.h"]
    headers, sources = map(str, files[1::2]), map(str, files[::2])
    shell(["gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-fsyntax-only", "-x", "c", *headers])
    shell(["g++", *strict, "-fsyntax-only", *sources])


def test_second_run_touches_nothing(protocols: list[Protocol], tmp_path: Path) -> None:
    (header,) = generate_cpp(of_name(protocols, "native"), tmp_path, amalgamate=True)
    before = header.stat().st_mtime_ns
    generate_cpp(of_name(protocols, "native"), tmp_path, amalgamate=True)
    assert header.stat().st_mtime_ns == before


def test_a_header_is_put_where_it_is_included_first() -> None:
    headers = {"wirebond/a.hpp": '#pragma once\n#include "wirebond/b.hpp"\nA\n', "wirebond/b.hpp": "#pragma once\nB\n"}
    text = '#include <x>\n#include "wirebond/a.hpp"\n#include "wirebond/b.hpp"\n#include "other.h"\nC\n'
    lines = amalgamated(text, headers).splitlines()
    assert [line for line in lines if not line.startswith(("//", "#ifndef", "#define", "#endif"))] == [
        "#include <x>", "B", "A", '#include "other.h"', "C",
    ]  # fmt: skip
    assert lines.count("#ifndef WIREBOND_AMALGAMATED_B_HPP") == 1
