"""``wirebond ports``: a list that fits 80 columns, JSON, and a plain answer where there is no port."""

from __future__ import annotations

import json

import pytest

from wirebond.cli.commands.ports import list_ports
from wirebond.cli.main import main


@pytest.fixture
def desk(machine):
    machine.usb_serial(
        "ttyUSB0", "1-1", "10c4:ea60", "cp210x", serial="0001", product="CP2102N", manufacturer="Silicon Labs"
    )
    machine.usb_serial("ttyUSB1", "1-2", "1a86:7523", has_file=False, product="USB Serial")
    machine.legacy_uart("ttyS0", "4", True, port="0x3F8")
    return machine


def test_each_port_is_listed_with_the_name_that_it_keeps(desk, capsys):
    assert list_ports(False, desk.root) == 0
    assert capsys.readouterr().out == (
        "port          its kind, and its permanent name\n/dev/ttyUSB0  Silicon Labs CP2102N, driver cp210x\n         "
        "     usb:10c4:ea60:0001\n/dev/ttyUSB1  USB Serial, driver ch341\n              usb:1a86:7523\n              "
        "there is no file /dev/ttyUSB1; `wirebond doctor /dev/ttyUSB1` shows the remedy\n/dev/ttyS0    UART, driver "
        "serial8250\n"
    )


def test_json_has_the_latency_timer_of_an_adapter(machine, capsys):
    machine.attributes(machine.usb_serial("ttyUSB0", "1-1", "0403:6001", "ftdi_sio"), latency_timer="16")
    assert list_ports(True, machine.root) == 0
    (port,) = json.loads(capsys.readouterr().out)["ports"]
    assert port["latency_timer_ms"] == 16


def test_json_has_all_that_is_known(desk, capsys):
    assert list_ports(True, desk.root) == 0
    ports = json.loads(capsys.readouterr().out)["ports"]
    assert [port["path"] for port in ports] == ["/dev/ttyUSB0", "/dev/ttyUSB1", "/dev/ttyS0"]
    first = ports[0]
    assert first.pop("group")
    assert first == {
        "path": "/dev/ttyUSB0",
        "description": "Silicon Labs CP2102N",
        "driver": "cp210x",
        "usb": {
            "vendor_id": "10c4",
            "product_id": "ea60",
            "serial": "0001",
            "manufacturer": "Silicon Labs",
            "product": "CP2102N",
            "interface": 0,
            "interface_name": None,
            "port_number": 0,
            "location": "1-1",
        },
        "by_id": None,
        "by_path": None,
        "has_device": True,
        "latency_timer_ms": None,
        "name": "usb:10c4:ea60:0001",
        "may_open": True,
    }
    assert not ports[1]["has_device"] and ports[1]["group"] is None and not ports[1]["may_open"]


def test_where_there_is_no_port_it_says_what_to_check(machine, capsys):
    assert list_ports(False, machine.root) == 1
    shown = capsys.readouterr().out
    assert shown.startswith("There is no serial port on this machine.\n")
    assert "`wirebond doctor`" in shown
    assert max(map(len, shown.splitlines())) <= 88
    assert list_ports(True, machine.root) == 1
    assert json.loads(capsys.readouterr().out) == {"ports": []}


def test_a_system_that_is_not_linux_is_said_to_be_the_reason(tmp_path, capsys):
    assert list_ports(False, tmp_path) == 1
    assert capsys.readouterr().out.startswith("Ports are listed from /sys/class/tty, which only Linux has.\n")


def test_a_devices_own_texts_cannot_command_the_terminal(machine, capsys):
    machine.usb_serial("ttyUSB0", "1-1", "10c4:ea60", product="\x1b[2J[red]x")
    list_ports(False, machine.root)
    shown = capsys.readouterr().out
    assert "\x1b" not in shown
    assert r"\x1b[2J[red]x" in shown


def test_the_command_is_wired(capsys):
    code = main(["ports", "--json"])
    assert code == (0 if any(port["has_device"] for port in json.loads(capsys.readouterr().out)["ports"]) else 1)
