"""Wrong arguments of programs: each gives a sentence of Wirebond's own, whatever Python says about the value."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import pytest

import wirebond
from wirebond import Link, MessageError, ProtocolFileError, UsageError, WirebondError
from wirebond.analysis.check.line_budget import parse_traffic
from wirebond.arguments import shown
from wirebond.cli.web import web_address
from wirebond.paths import protocols
from wirebond.protocol import loads

pytestmark = pytest.mark.live

DIFFDRIVE = protocols() / "diffdrive.yaml"
HUGE = 10**5000  # Python refuses to write it
DIGITS = "9" * 5000  # Python refuses to read it


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (HUGE, "an integer of more than 99 digits"),
        (-HUGE, "a negative integer of more than 99 digits"),
        ([HUGE], "a value of the type list that cannot be shown"),
        ("x" * 100, "'" + "x" * 76 + "..."),
        (None, "None"),
    ],
    ids=range(5),
)
def test_any_value_can_be_shown(value: object, text: str) -> None:
    assert shown(value) == text


CALLS: list[tuple[str, Callable[[Link], Any], str]] = [
    ("send", lambda link: link.send(None), "the message is None; expected a message's name, or an object"),  # type: ignore[arg-type]
    ("send class", lambda link: link.send(dict), "the message is <class 'dict'>; expected a message's name"),  # type: ignore[arg-type]
    ("repeat", lambda link: link.repeat(5), "the message is 5; expected a message's name"),  # type: ignore[arg-type]
    ("request", lambda link: link.request(None), "the message is None; expected a message's name"),  # type: ignore[call-overload]
    ("latest", lambda link: link.latest(None), "None is not a message of a generated module"),  # type: ignore[call-overload]
    ("receive", lambda link: link.receive(None), "timeout is None; expected seconds, such as 0.5; for no limit"),  # type: ignore[arg-type]
    ("receive text", lambda link: link.receive("1"), "timeout is '1'; expected seconds"),  # type: ignore[arg-type]
    ("run", lambda link: link.run(timeout=HUGE), "timeout is an integer of more than 99 digits; expected seconds"),
    (
        "request timeout",
        lambda link: link.request("status_query", timeout=None),
        "timeout is None; expected more than 0",
    ),  # type: ignore[call-overload]
    ("hold", lambda link: link.repeat("velocity", hold=None), "hold is None; expected more than 0"),  # type: ignore[arg-type]
    ("rates", lambda link: link.rates(None), "window is None; expected seconds"),  # type: ignore[arg-type]
    ("tap", lambda link: link.tap(HUGE), "the tap's capacity is an integer of more than 99 digits; expected a whole"),
    ("host_time", lambda link: link.host_time(None), "mcu_us is None; expected microseconds"),  # type: ignore[arg-type]
    ("recover", lambda link: link.recover(HUGE), "an integer of more than 99 digits is not an action"),  # type: ignore[arg-type]
    ("field", lambda link: link.send("velocity", linear=HUGE, angular=0), "velocity.linear is too large"),
    (
        "list",
        lambda link: link.send("velocity", linear=[HUGE], angular=0),
        "velocity.linear is a value of the type list",
    ),
]


@pytest.mark.parametrize(("call", "sentence"), [pytest.param(call, text, id=name) for name, call, text in CALLS])
def test_a_link_says_what_it_expects(call: Callable[[Link], Any], sentence: str) -> None:
    with wirebond.open(DIFFDRIVE, "sim:") as link, pytest.raises(WirebondError) as caught:
        call(link)
    assert str(caught.value).startswith(sentence)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"baud": 115200.5}, "baud is 115200.5; expected a whole number from 1 to 100000000 bits per second"),
        ({"baud": "115200"}, "baud is '115200'; expected a whole number"),
        ({"baud": HUGE}, "baud is an integer of more than 99 digits; expected a whole number"),
        ({"port": 5}, "port is 5; expected a port, such as /dev/ttyUSB0"),
        ({"protocol": None}, "the protocol file is None; expected a path"),
        ({"adapter_latency": "1"}, "adapter_latency is '1'; expected 0 to 1 s"),
        ({"role": HUGE}, "role is an integer of more than 99 digits; expected 'host' or 'mcu'"),
    ],
    ids=range(7),
)
def test_opening_says_what_it_expects(options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(UsageError) as caught:
        wirebond.open(**{"protocol": DIFFDRIVE, "port": "sim:", **options})
    assert str(caught.value).startswith(sentence)


def test_run_in_a_handler_says_that_it_would_wait_for_itself() -> None:
    found: list[BaseException] = []
    asked = threading.Event()
    with wirebond.open(DIFFDRIVE, "sim:") as link:

        @link.on()
        def handle(message: wirebond.Message) -> None:
            if not found:
                try:
                    link.run()
                except WirebondError as error:
                    found.append(error)
                asked.set()

        assert asked.wait(60)
    assert isinstance(found[0], UsageError)
    assert str(found[0]).startswith("run() was called in a handler, and no handler is called until it returns")


def test_integers_of_5000_digits_in_values_are_refused_in_a_sentence() -> None:
    codec = wirebond.load(DIFFDRIVE)
    for message in codec.model.messages:
        for field in message.fields:
            for value in (HUGE, -HUGE, [HUGE], {"x": HUGE}):
                with pytest.raises(MessageError, match=field.name):
                    codec.encode(message.name, {f.name: value if f is field else 0 for f in message.fields})


@pytest.mark.parametrize("digits", [DIGITS, f"-{DIGITS}", f"0x{DIGITS}", f"1.{DIGITS}", f'"{DIGITS}"'], ids=range(5))
@pytest.mark.parametrize(
    "place",
    ["id: 0x02", "-2.0, 2.0", "every: 50 ms", "xor8 ", "reserved: 2", "default: 0", "baud: 115200", "payload: 4"],
)
def test_integers_of_5000_digits_in_a_file_are_refused_in_a_sentence(place: str, digits: str) -> None:
    text = DIFFDRIVE.read_text()
    assert place in text
    key, colon, _ = place.partition(": ")
    with pytest.raises(ProtocolFileError):
        loads(text.replace(place, f"{key}: {digits}" if colon else digits, 1))


def test_ports_and_sizes_of_5000_digits_are_refused_in_a_sentence() -> None:
    with pytest.raises(UsageError, match="--web is"):
        web_address(f"localhost:{DIGITS}")
    with pytest.raises(UsageError, match="names no frames"):
        parse_traffic(loads(DIFFDRIVE.read_text()), f"mcu:{DIGITS}=100")
