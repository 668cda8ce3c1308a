"""Generated Python modules: typed messages that carry the engine's bytes, and that notice when their file changed."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from copy import copy
from dataclasses import FrozenInstanceError, fields, replace
from pathlib import Path
from types import ModuleType

import pytest

import wirebond
from wirebond.generate.code import generate_python
from wirebond.generate.code.python import module_name
from wirebond.generate.doc.examples import example_values
from wirebond.protocol.loader import load, loads

HERE = Path(__file__).parent
ROOT = HERE.parents[2]
FILES = [*sorted((ROOT / "protocols").glob("*.yaml")), HERE / "every_type.yaml", HERE / "every_shape.yaml"]


def module_of(path: Path, folder: Path) -> ModuleType:
    """The module generated from ``path`` into ``folder``, imported."""
    (made,) = generate_python(load(path), folder)
    spec = importlib.util.spec_from_file_location(f"generated_{made.stem}", made)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_messages_come_back_with_their_types_and_make_the_same_bytes(path: Path, tmp_path: Path) -> None:
    codec = wirebond.load(path)
    module = module_of(path, tmp_path)
    for message in codec.model.messages:
        frame = codec.encode(message.name, example_values(message))
        decoder = codec.decoder("mcu" if message.sender == "mcu" else "host")
        (received,) = decoder.feed(frame)
        typed = module.from_message(received)
        assert message.name == typed.NAME
        assert typed.encode() == frame
        assert type(typed)(**{field.name: getattr(typed, field.name) for field in fields(typed) if field.init}) == typed
        assert hash(typed) == hash(module.from_message(received))


def test_a_received_header_is_no_value_of_the_message(tmp_path: Path) -> None:
    headers = module_of(HERE / "every_header.yaml", tmp_path)
    pieces = [headers.Answer(angle=0.5).encode(header={"servo": servo}) for servo in (3, 4)]
    one, other = map(headers.from_message, headers.codec.decoder("mcu").feed(b"".join(pieces)))
    assert [message.header["servo"] for message in (one, other)] == [3, 4]
    assert one == other == headers.Answer(angle=0.5)
    changed = replace(one, angle=0.25)
    assert changed == headers.Answer(angle=0.25)
    assert changed.header == {}  # it was not sent
    assert changed.encode() == headers.Answer(angle=0.25).encode()  # to the file's address, as any other
    assert copy(one).header == one.header
    with pytest.raises(ValueError, match="header is declared with init=False"):
        replace(one, header={"servo": 5})


def test_fields_have_types_of_their_own(tmp_path: Path) -> None:
    shapes = module_of(HERE / "every_shape.yaml", tmp_path)
    with pytest.raises(TypeError, match="missing 1 required keyword-only argument: 'values_'"):
        shapes.Samples()  # a list without a default
    scan = shapes.Scan(
        origin=shapes.Pose(at=shapes.Point(x=0.5)),
        corners=(shapes.ScanCorners(pose=shapes.Pose(at=shapes.Point(x=1.0)), far=2.0),) * 2,
        points=(shapes.Point(x=1.0, y=2.0),),
        echoes=(7,),
        legs=(),
    )
    (back,) = map(shapes.from_message, shapes.codec.decoder("host").feed(scan.encode()))
    assert back == scan
    assert back.origin.mode is shapes.PoseMode.STILL
    assert back.own == shapes.ScanOwn(a=7, raw=b"")
    told = shapes.Told(
        head=shapes.ToldHead(kind=2),
        levels=(0.5,),
        marks=(9,),
        points=(),
        values_=(3, 4),
        inner=shapes.ToldInner(text="ab"),
        legs=(),
    )
    (back,) = map(shapes.from_message, shapes.codec.decoder("host").feed(told.encode(sender="host")))
    assert back == told
    defaults = shapes.Defaults()
    assert defaults.encode() == shapes.codec.encode("defaults")
    assert defaults.modes == (shapes.DefaultsModes.ON, shapes.DefaultsModes.OFF)
    assert defaults.faults == shapes.DefaultsFaults.HOT | shapes.DefaultsFaults.STALLED
    with pytest.raises(FrozenInstanceError):
        scan.name = "other"


def test_values_without_a_name_stay_numbers(tmp_path: Path) -> None:
    rover = module_of(ROOT / "protocols" / "diffdrive.yaml", tmp_path)
    status = rover.Status(battery=12.0, errors=rover.StatusErrors(0x81), state=rover.StatusState(0))
    (back,) = map(rover.from_message, rover.codec.decoder("mcu").feed(status.encode()))
    assert back.errors == 0x81
    assert rover.StatusErrors.LEFT_MOTOR in back.errors
    with pytest.raises(wirebond.MessageError, match="is 9; expected one of"):
        rover.Parameter(name=9, value=0.0).encode()


NEWER = """
wirebond: 1
protocol: newer
frame: [delimiter: 0x00, cobs: [id: u8, payload: rest, check: crc-16/ibm-sdlc], delimiter: 0x00]
messages: {later: {id: 0xEE, sender: mcu}}
"""


def test_frames_of_no_known_message_are_none(tmp_path: Path) -> None:
    native = module_of(ROOT / "protocols" / "native.yaml", tmp_path)
    newer = wirebond.Codec(loads(NEWER))
    (received,) = native.codec.decoder("mcu").feed(newer.encode("later"))
    assert native.from_message(received) is None


def test_module_notices_that_its_file_has_changed(tmp_path: Path) -> None:
    source = tmp_path / "protocols" / "rover.yaml"
    source.parent.mkdir()
    text = (ROOT / "protocols" / "diffdrive.yaml").read_text()
    source.write_text(text)
    module = module_of(source, tmp_path / "package" / "link")
    source.write_text(text.replace("unit: m/s, ", "").replace("description: ", "description: Changed. "))
    module_spec = importlib.util.spec_from_file_location("again", module.__file__)
    assert module_spec is not None and module_spec.loader is not None
    again = importlib.util.module_from_spec(module_spec)
    sys.modules["again"] = again
    module_spec.loader.exec_module(again)  # the bytes mean the same
    source.write_text(text.replace("scale: 0.001", "scale: 0.01", 1))
    with pytest.raises(wirebond.ProtocolMismatchError, match=r"was generated from another .*rover.yaml: .* run `wireb"):
        module_spec.loader.exec_module(again)
    source.unlink()
    with pytest.raises(wirebond.ProtocolFileError, match=r"rover\.yaml: "):
        module_spec.loader.exec_module(again)


def test_message_that_was_decoded_with_another_file_is_refused_in_a_sentence(tmp_path: Path) -> None:
    rover = module_of(ROOT / "protocols" / "diffdrive.yaml", tmp_path)
    text = (ROOT / "protocols" / "diffdrive.yaml").read_text().replace("left_ticks", "left")
    other = wirebond.Codec(loads(text))
    (received,) = other.decoder("mcu").feed(other.encode("odometry", left=1, right_ticks=2))
    with pytest.raises(wirebond.ProtocolMismatchError, match="odometry has no 'left_ticks'; it has left, right_ticks"):
        rover.from_message(received)


def test_protocol_without_a_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(wirebond.UsageError, match="signal was not loaded from a file"):
        generate_python(loads(AWKWARD), tmp_path)


def test_module_hides_none_of_the_standard_library() -> None:
    assert module_name(loads(AWKWARD)) == "signal_protocol"


AWKWARD = """
wirebond: 1
protocol: signal
description: 'Three quotes: \"\"\" and a backslash \\'
frame: [magic: 0xAA, length: u8, id: u8, payload: by_length, check: crc-16/modbus]
types:
  int_flag: {str: {type: u8, default: 3}}
messages:
  none: {id: 1, sender: host, fields: {str: {type: text, size: 4, default: '"'}, other: {type: bytes, max: 3}}}
  callable: {id: 2, sender: host, fields: {self: {type: u8}, cls: {type: u8}, codec: {type: f32}, bytes: {type: u8}}}
  any: {id: 3, sender: mcu, fields: {values: {type: u8, enum: {none: 0, mro: 1, name: 2}}, typed: {struct: int_flag}}}
  message: {id: 4, sender: mcu, fields: {tuple: {type: u8, count: 1, default: [7]}, encode: {type: u8}}}
  message_encode: {id: 5, sender: mcu, fields: {dataclass: {type: u8, flags: {encode: 0}, default: [encode]}}}
"""


@pytest.mark.live
def test_names_that_are_hard_on_python_do_not_meet(tmp_path: Path) -> None:
    source = tmp_path / "awkward.yaml"
    source.write_text(AWKWARD, encoding="utf-8")
    module = module_of(source, tmp_path)
    codec = wirebond.load(source)
    for message in codec.model.messages:
        frame = codec.encode(message.name, example_values(message))
        (received,) = codec.decoder(message.sender).feed(frame)
        assert module.from_message(received).encode() == frame
    assert module.AnyMessage != module.Any
    assert '"""' in module.__doc__
    command = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(ROOT / ".mypy_cache")]
    done = subprocess.run([*command, "signal_protocol.py"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


USE = """
import diffdrive
import wirebond

def ask(link: wirebond.Link) -> float:
    reply: wirebond.Message = link.request("status_query")
    return link.request(diffdrive.StatusQuery(), timeout=0.5).battery + float(reply["battery"])

async def ask_too(link: wirebond.Link) -> diffdrive.Status:
    return await link.aio.request(diffdrive.StatusQuery())

def drive() -> bytes:
    velocity = diffdrive.Velocity(linear=0.5)
    for received in diffdrive.codec.decoder("mcu").feed(velocity.encode()):
        match diffdrive.from_message(received):
            case diffdrive.Status(battery=battery, errors=errors) if diffdrive.StatusErrors.ENCODER in errors:
                print(battery + 1)
            case diffdrive.Odometry() as odometry:
                print(odometry.left_ticks << 1)
    return velocity.encode()
"""
MISUSE = """
import diffdrive, wirebond

diffdrive.Velocity(linar=0.5)
diffdrive.Velocity(linear="fast")
diffdrive.Status(battery=1.0, errors=1, state=diffdrive.StatusState.ESTOP)
diffdrive.Velocity().speed

def ask(link: wirebond.Link) -> None:
    link.request(diffdrive.StatusQuery()).volts
    link.request(diffdrive.Velocity())
"""


@pytest.mark.live
def test_modules_are_clean_under_strict_mypy_and_misuse_is_found(tmp_path: Path) -> None:
    for path in FILES:
        generate_python(load(path), tmp_path)
    (tmp_path / "use.py").write_text(USE)
    (tmp_path / "misuse.py").write_text(MISUSE)
    command = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(ROOT / ".mypy_cache"), "."]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    found = [line.split(": ")[0] for line in done.stdout.splitlines() if ": error: " in line]
    assert found == [f"misuse.py:{line}" for line in (4, 5, 6, 7, 10, 11)], done.stdout + done.stderr
