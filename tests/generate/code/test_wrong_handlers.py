"""A handler's function that would never be called does not compile, and the compiler says what to write."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from wirebond.generate.code import generate_cpp
from wirebond.protocol.loader import load, loads

pytestmark = pytest.mark.live

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
struct Handler {base} {{
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


def words(folder: Path, protocol: str, function: str, statement: str = "", base: str = "") -> str:
    """Return the compiler's messages about a link's handler; empty if it compiles."""
    return said_of(folder, USE.format(protocol=protocol, function=function, statement=statement, base=base))


def said_of(folder: Path, source: str) -> str:
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
        ("diffdrive", "template <class Message, class = typename Message::Info> void on(const Message&) {}"),
        ("diffdrive", "template <class Message> void on(Message) {}"),
        ("headers", "void on(const headers::Move&, const headers::Header&) {}"),
        ("headers", "void on(const headers::Move&, headers::Header) {}"),
        ("headers", "void on(const headers::Note&, const headers::Header&) {}"),
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
def test_a_wrong_signature_is_reported(protocol: str, function: str, advice: str, generated: Path) -> None:
    assert advice in words(generated, protocol, function)


OF_THIS_END = [
    ("diffdrive", "void on(const diffdrive::Odometry&) {}", "diffdrive::Odometry"),
    ("diffdrive", "void on(diffdrive::Odometry) {}", "diffdrive::Odometry"),
    ("diffdrive", "void on(diffdrive::Odometry&) {}", "diffdrive::Odometry"),
    ("headers", "void on(const headers::Answer&) {}", "headers::Answer"),
    ("headers", "void on(const headers::Answer&, const headers::Header&) {}", "headers::Answer"),
]


@pytest.mark.parametrize(("protocol", "function", "message"), OF_THIS_END)
def test_an_on_for_a_message_of_this_end_is_reported(
    protocol: str, function: str, message: str, generated: Path
) -> None:
    said = words(generated, protocol, function)
    assert "for this message, which only its own end sends: it would never be called. Remove it, or derive" in said
    assert f"OnOfRightEnd<Handler, {message}>" in said


@pytest.mark.parametrize(("protocol", "function", "message"), OF_THIS_END)
def test_a_class_that_serves_both_ends_has_an_on_for_each_message(
    protocol: str, function: str, message: str, generated: Path
) -> None:
    assert not words(generated, protocol, function, base=": wirebond::ServesBothEnds")


RECEIVER = """
#include "{protocol}.hpp"
struct Handler {base} {{
  void on(const {protocol}::{message}&) {{}}
}};
void feed({protocol}::Receiver<{protocol}::{source}>& receiver, Handler& handler) {{
  receiver.feed(nullptr, 0, 0, handler);
}}
"""

LISTS = """\
  never_sent: {id: 0x7E, sender: host}
  latest_messages: {id: 0x7D, sender: mcu, queue: latest}
"""


@pytest.mark.parametrize(
    ("protocol", "source", "message", "is_received"),
    [
        ("diffdrive", "FromMcu", "Odometry", True),
        ("diffdrive", "FromMcu", "Velocity", False),
        ("diffdrive", "FromHost", "Velocity", True),
        ("diffdrive", "FromHost", "Odometry", False),
        ("headers", "FromMcu", "Note", True),  # of both ends
        ("headers", "FromHost", "Note", True),
    ],
)
def test_a_receiver_knows_which_end_it_is_for(
    protocol: str, source: str, message: str, is_received: bool, generated: Path
) -> None:
    def said(base: str) -> str:
        text = RECEIVER.format(protocol=protocol, source=source, message=message, base=base)
        return said_of(generated, text)

    assert ("which only its own end sends" in said("")) == (not is_received)
    assert bool(said("")) == (not is_received)
    assert not said(": wirebond::ServesBothEnds")


def test_messages_may_be_called_as_the_lists_of_messages_are(tmp_path: Path) -> None:
    text = (PROTOCOLS / "diffdrive.yaml").read_text(encoding="utf-8")
    named = text.replace("\nmessages:\n", "\nmessages:\n" + LISTS)
    assert named != text
    generate_cpp(loads(named), tmp_path)
    for source, message in (("FromHost", "NeverSentMessage"), ("FromMcu", "LatestMessagesMessage")):
        assert not said_of(tmp_path, RECEIVER.format(protocol="diffdrive", source=source, message=message, base=""))


@pytest.mark.parametrize(
    ("protocol", "statement", "advice"),
    [
        ("diffdrive", "(void)link_of_it.send(diffdrive::Status{}, 7);", "no header field; send the message alone"),
        ("diffdrive", "(void)link_of_it.header();", "frames of this protocol have no header field"),
        ("headers", "(void)link_of_it.send(headers::Answer{}, Other{});", "takes the `Header` of its protocol"),
        ("headers", "headers::Header header;", "no matching function"),
    ],
)
def test_a_wrong_header_is_reported(protocol: str, statement: str, advice: str, generated: Path) -> None:
    assert advice in words(generated, protocol, "", statement)
