"""A handler's function that would never be called does not compile, and the compiler says what to write."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from wirebond.gen import generate_cpp
from wirebond.protocol.loader import load

HERE = Path(__file__).parent
PROTOCOLS = HERE.parents[2] / "protocols"

USE = """
#include "{protocol}_link.hpp"
struct Port {{
  bool start_receive(std::uint8_t*, std::size_t) {{ return true; }}
  bool receiving() const {{ return true; }}
  std::size_t receive_position() const {{ return 0; }}
  bool start_transmit(const std::uint8_t*, std::size_t) {{ return true; }}
  void stop_transmit() {{}}
  void pend() {{}}
  bool reaches(const void*, std::size_t) const {{ return true; }}
}};
struct Other {{}};
struct Handler {{
  void stop() {{}}
  void safe_mode() {{}}
  void rest() {{}}
  {function}
}};
Handler handler;
Port port;
{protocol}::McuBuffers<256, 256> buffers;
{protocol}::McuLink link_of_it{{handler, port, buffers}};
void poll() {{
  link_of_it.poll(0);
  {statement}
}}
"""


@pytest.fixture(scope="module")
def generated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("handlers")
    for path in (PROTOCOLS / "diffdrive.yaml", HERE / "every_header.yaml"):
        generate_cpp(load(path), folder)
    return folder


def words(folder: Path, protocol: str, function: str, statement: str = "") -> str:
    """What the compiler says; empty where it compiles."""
    source = USE.format(protocol=protocol, function=function, statement=statement)
    command = ["g++", "-std=c++17", "-fsyntax-only", f"-I{folder}", "-x", "c++", "-"]
    done = subprocess.run(command, input=source, capture_output=True, text=True, check=False)
    assert (done.returncode == 0) == (not done.stderr), done.stderr
    return done.stderr


@pytest.mark.parametrize(
    ("protocol", "function"),
    [
        ("diffdrive", "void on(const diffdrive::Velocity&) {}"),
        ("diffdrive", "void on(diffdrive::Velocity) {}"),
        ("diffdrive", "template <class Message> void on(const Message&) {}"),
        ("diffdrive", "template <class Message> bool fill(Message&) { return true; }"),
        ("diffdrive", "template <class Message> bool fill(Message&&) { return true; }"),
        ("headers", "void on(const headers::Move&, const headers::Header&) {}"),
        ("headers", "void on(const headers::Move&, headers::Header) {}"),
        ("headers", "template <class Message, class Header> void on(const Message&, const Header&) {}"),
        ("headers", "bool fill(headers::Beat&, headers::Header&) { return true; }"),
    ],
)
def test_right_functions_compile(protocol: str, function: str, generated: Path) -> None:
    assert not words(generated, protocol, function)


@pytest.mark.parametrize(
    ("protocol", "function", "advice"),
    [
        (
            "diffdrive",
            "void on(diffdrive::Velocity&) {}",
            "wants to change this message; write `void on(const Message&)`",
        ),
        ("diffdrive", "void on(const diffdrive::Velocity&, int) {}", "frames of this protocol have no header field"),
        ("diffdrive", "bool fill(const diffdrive::Odometry&) { return true; }", "cannot change this message"),
        ("diffdrive", "bool fill(diffdrive::Odometry) { return true; }", "cannot change this message"),
        ("diffdrive", "bool fill(diffdrive::Odometry&, Other&) { return true; }", "have no header field"),
        ("headers", "void on(const headers::Move&, const Other&) {}", "is not this protocol's header"),
        ("headers", "void on(const headers::Move&, headers::Header&) {}", "is not this protocol's header"),
        ("headers", "bool fill(headers::Beat&, int) { return true; }", "is not this protocol's header to change"),
    ],
)
def test_a_wrong_signature_is_told(protocol: str, function: str, advice: str, generated: Path) -> None:
    assert advice in words(generated, protocol, function)


@pytest.mark.parametrize(
    ("protocol", "statement", "advice"),
    [
        ("diffdrive", "(void)link_of_it.send(diffdrive::Status{}, 7);", "no header field; send the message alone"),
        ("diffdrive", "(void)link_of_it.header();", "frames of this protocol have no header field"),
        ("headers", "(void)link_of_it.send(headers::Answer{}, Other{});", "takes the `Header` of its protocol"),
        ("headers", "headers::Header header;", "no matching function"),
    ],
)
def test_a_wrong_header_is_told(protocol: str, statement: str, advice: str, generated: Path) -> None:
    assert advice in words(generated, protocol, "", statement)
