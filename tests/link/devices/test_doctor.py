"""``wirebond doctor``: which ports it looks at, what it prints, its exit code."""

from __future__ import annotations

import json

import pytest

from wirebond.cli.commands.doctor import examine_machine
from wirebond.cli.main import main
from wirebond.errors import UsageError
from wirebond.link.devices.doctor import Machine, Verdict, examine


def said(fake, name=None):
    """By port and check, the verdict."""
    return {(found.port, found.check): found.verdict for found in examine(Machine(fake.root), name)}


@pytest.fixture
def desk(machine):
    """An FTDI adapter that minicom holds, a board on which ModemManager tries AT commands, and a console."""
    port = machine.usb_serial("ttyUSB0", "1-1", "0403:6001", "ftdi_sio", product="FT232R USB UART", manufacturer="FTDI")
    machine.attributes(port, latency_timer="16")
    machine.process(4711, "minicom", opens="/dev/ttyUSB0")
    board = machine.usb_device("1-2", "0483:5740", serial="357", product="STM32 Virtual ComPort")
    machine.acm("ttyACM0", board, 0, bInterfaceSubClass="02", bInterfaceProtocol="01")
    machine.process(800, "ModemManager", "/usr/sbin/ModemManager")
    machine.uart("ttyS0", "pnp", "serial", type="4")
    machine.write("sys/class/tty/console/active", "ttyS0\n")
    return machine


def test_without_a_port_all_are_examined_and_findings_are_warnings(desk, capsys):
    found = said(desk)
    assert {port for port, _ in found} == {"/dev/ttyACM0", "/dev/ttyUSB0", "/dev/ttyS0", None}
    assert found["/dev/ttyUSB0", "holder"] is Verdict.WARNING
    assert found["/dev/ttyS0", "console"] is Verdict.WARNING
    assert found["/dev/ttyACM0", "modem manager"] is Verdict.WARNING
    assert examine_machine(None, False, desk.root) == 0


def test_a_usb_device_without_its_file_is_a_problem_also_where_no_port_is_asked_for(machine):
    machine.usb_serial("ttyUSB0", "1-1", "1a86:7523", has_file=False)
    assert said(machine)["/dev/ttyUSB0", "device"] is Verdict.PROBLEM


def test_the_port_that_is_asked_for_is_examined_alone_and_must_be_free(desk):
    found = said(desk, "/dev/ttyUSB0")
    assert {port for port, _ in found} == {"/dev/ttyUSB0", None}
    assert found["/dev/ttyUSB0", "holder"] is Verdict.PROBLEM
    assert said(desk, "/dev/ttyS0")["/dev/ttyS0", "console"] is Verdict.PROBLEM
    assert examine_machine("/dev/ttyUSB0", False, desk.root) == 1
    assert examine_machine("usb:0483:5740", False, desk.root) == 0


def test_a_port_has_the_names_that_it_has_elsewhere(desk):
    desk.link("dev/serial/by-id/usb-FTDI-if00-port0", "dev/ttyUSB0")
    desk.link("tmp/mcu", "dev/ttyUSB0")
    for name in ("usb:0403:6001", "/dev/serial/by-id/usb-FTDI-if00-port0", "/tmp/mcu"):
        assert said(desk, name)["/dev/ttyUSB0", "holder"] is Verdict.PROBLEM


def test_a_port_that_is_not_there(desk, capsys):
    assert examine_machine("/dev/ttyUSB7", False, desk.root) == 1
    shown = capsys.readouterr().out
    assert "there is no /dev/ttyUSB7; there are" in shown
    assert "/dev/ttyACM0" in shown
    assert said(desk, "usb:1a86:7523")["usb:1a86:7523", "port"] is Verdict.PROBLEM


def test_a_name_that_fits_several_ports_shows_them_all(desk):
    desk.usb_serial("ttyUSB1", "1-3", "0403:6001", "ftdi_sio")
    found = said(desk, "usb:0403:6001")
    assert found["usb:0403:6001", "port"] is Verdict.PROBLEM
    assert {port for port, _ in found} == {"usb:0403:6001", "/dev/ttyUSB0", "/dev/ttyUSB1", None}


def test_a_device_without_its_file_is_found_by_its_usb_name(machine):
    machine.usb_serial("ttyUSB0", "1-1", "1a86:7523", has_file=False)
    machine.write(".dockerenv")
    assert said(machine, "usb:1a86:7523")["/dev/ttyUSB0", "device"] is Verdict.PROBLEM


def test_a_pty_is_examined_as_far_as_it_can_be(machine):
    machine.write("dev/pts/3")
    machine.process(4711, "minicom", opens="/dev/pts/3")
    found = said(machine, "/dev/pts/3")
    assert found["/dev/pts/3", "holder"] is Verdict.PROBLEM
    assert found["/dev/pts/3", "device"] is Verdict.OK


def test_an_address_is_no_port_of_this_machine(machine):
    assert said(machine, "tcp://robot:4000")["tcp://robot:4000", "port"] is Verdict.CANNOT_TELL


def test_a_system_that_is_not_linux_cannot_be_examined(tmp_path):
    (found,) = examine(Machine(tmp_path), "COM3")
    assert (found.port, found.verdict) == ("COM3", Verdict.CANNOT_TELL)


def test_a_link_that_leads_to_itself_is_no_port(machine):
    machine.link("dev/loop", "dev/loop")
    assert said(machine, "/dev/loop")["/dev/loop", "port"] is Verdict.PROBLEM


def test_a_name_that_is_written_wrong(machine, capsys):
    with pytest.raises(UsageError):
        examine(Machine(machine.root), "usb:1a86:5")
    assert main(["doctor", "usb:1a86:5"]) == 2
    assert "is not four hex digits" in capsys.readouterr().err


def test_a_machine_without_ports_says_what_to_check(machine, capsys):
    assert examine_machine(None, False, machine.root) == 1
    shown = capsys.readouterr().out
    assert "the kernel has no serial port" in shown
    assert "$ sudo dmesg --follow" in shown
    machine.write("run/.containerenv")
    examine_machine(None, False, machine.root)
    assert "this Podman container sees what its host sees" in " ".join(capsys.readouterr().out.split())


def test_printed_report(desk, capsys):
    examine_machine("/dev/ttyUSB0", False, desk.root)
    shown = capsys.readouterr().out
    assert shown.startswith(
        "/dev/ttyUSB0  FTDI FT232R USB UART\n"
        "  problem      holder         minicom (process 4711) has it open\n"
        "    $ kill 4711\n"
        "  warning      latency timer  the adapter may hold received bytes back for 16\n"
        "                              ms. A link of Wirebond asks for 1 ms while it is\n"
    )
    assert "\n    $ echo 1 | sudo tee /sys/bus/usb-serial/devices/ttyUSB0/latency_timer\n" in shown
    assert shown.endswith("1 problem, 1 warning\n")
    assert all(len(line) <= 80 for line in shown.splitlines() if not line.startswith("    $ "))


def test_json(desk, capsys):
    assert examine_machine("/dev/ttyUSB0", True, desk.root) == 1
    answer = json.loads(capsys.readouterr().out)
    assert answer["ok"] is False
    assert {
        "check": "holder",
        "verdict": "problem",
        "sentence": "minicom (process 4711) has it open",
        "port": "/dev/ttyUSB0",
        "cure": ["kill 4711"],
        "then": None,
    } in answer["findings"]


def test_nothing_is_changed(desk, capsys):
    def tree():
        return {path: path.lstat().st_mtime_ns for path in desk.root.rglob("*")}

    before = tree()
    examine_machine(None, False, desk.root)
    assert tree() == before


def test_a_devices_own_texts_cannot_command_the_terminal(machine, capsys):
    machine.usb_serial("ttyUSB0", "1-1", "10c4:ea60", product="\x1b[2J[red]x")
    machine.write("etc/udev/rules.d/brltty[red].rules", 'ENV{PRODUCT}=="10c4/ea60/*"\n')
    examine_machine(None, False, machine.root)
    shown = capsys.readouterr().out
    assert "\x1b" not in shown
    assert r"\x1b[2J[red]x" in shown
    assert "/etc/udev/rules.d/brltty[red].rules\n" in shown


def test_this_machine_is_examined_without_an_error(capsys):
    assert main(["doctor", "--json"]) in (0, 1)
    assert json.loads(capsys.readouterr().out)["findings"]
