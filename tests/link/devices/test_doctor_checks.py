"""Each check of doctor finds what is in the way, and finds nothing where there is nothing."""

from __future__ import annotations

import os

import pytest

from wirebond.link.devices.doctor.brltty import check_brltty
from wirebond.link.devices.doctor.console import check_console
from wirebond.link.devices.doctor.device import check_device, check_permission
from wirebond.link.devices.doctor.driver import check_driver
from wirebond.link.devices.doctor.finding import Verdict
from wirebond.link.devices.doctor.holder import check_holder
from wirebond.link.devices.doctor.latency_timer import check_latency_timer
from wirebond.link.devices.doctor.machine import Machine
from wirebond.link.devices.doctor.modem_manager import check_modem_manager
from wirebond.link.devices.doctor.power import check_autosuspend
from wirebond.link.devices.doctor.surroundings import check_wsl
from wirebond.link.devices.permission import User

OK, WARNING, PROBLEM, CANNOT_TELL = Verdict.OK, Verdict.WARNING, Verdict.PROBLEM, Verdict.CANNOT_TELL


def asked(check, fake, user=None):
    """Return the result of a check for the only port of the machine."""
    machine = Machine(fake.root, user)
    (port,) = machine.ports
    return check(machine, port)


# ---- the device


def test_a_device_that_is_there(machine):
    machine.usb_serial("ttyUSB0", "1-1", "1a86:7523")
    assert asked(check_device, machine).verdict is OK


def test_a_container_that_was_not_given_the_device(machine):
    machine.usb_serial("ttyUSB0", "1-1", "1a86:7523", has_file=False)
    machine.write(".dockerenv")
    found = asked(check_device, machine)
    assert found.verdict is PROBLEM
    assert "this Docker container was not given /dev/ttyUSB0" in found.sentence
    assert found.cure == (
        "docker run --device=/dev/ttyUSB0 ...",
        "docker run -v /dev:/dev --device-cgroup-rule='c 188:* rmw' ...",
    )


def test_a_device_that_udev_did_not_make(machine):
    machine.usb_serial("ttyUSB0", "1-1", "1a86:7523", has_file=False)
    found = asked(check_device, machine)
    assert found.verdict is PROBLEM
    assert "udev does not run" in found.sentence
    assert found.cure[0] == "udevadm test /sys/class/tty/ttyUSB0"


# ---- rights


@pytest.fixture
def owned(machine):
    """A port of the group uucp that its group may use, and a function that makes users."""
    machine.usb_serial("ttyUSB0", "1-1", "1a86:7523")
    file = machine.root / "dev/ttyUSB0"
    file.chmod(0o660)
    if os.geteuid() == 0:
        os.chown(file, 1, 14)
    machine.write("etc/group", f"uucp:x:{file.stat().st_gid}:ben\n")
    return machine


def stranger(fake, name="ana"):
    status = (fake.root / "dev/ttyUSB0").stat()
    return User(status.st_uid + 1, frozenset({status.st_gid + 1}), name)


def test_a_user_outside_the_group_gets_the_command_with_its_name(owned):
    found = asked(check_permission, owned, stranger(owned))
    assert found.verdict is PROBLEM
    assert found.sentence == "you may not open it: it belongs to the group uucp, and you are not in it"
    assert found.cure == ("sudo usermod -aG uucp $USER",)
    assert "log out and in again" in found.then


def test_a_user_who_joined_the_group_after_logging_in(owned):
    found = asked(check_permission, owned, stranger(owned, "ben"))
    assert found.verdict is PROBLEM
    assert found.cure == ("newgrp uucp",)


def test_a_device_for_its_owner_alone_gets_a_rule(owned):
    (owned.root / "dev/ttyUSB0").chmod(0o600)
    found = asked(check_permission, owned, stranger(owned))
    assert found.verdict is PROBLEM
    assert found.cure[0] == (
        """echo 'SUBSYSTEM=="tty", ATTRS{idVendor}=="1a86", ATTRS{idProduct}=="7523", GROUP="uucp", MODE="0660"' """
        "| sudo tee -a /etc/udev/rules.d/70-serial-port.rules"
    )
    assert found.cure[-1] == "sudo usermod -aG uucp $USER"


def test_a_device_that_a_login_has_taken_gets_no_rule(owned):
    file = owned.root / "dev/ttyUSB0"
    file.chmod(0o620)
    owned.write("etc/group", f"tty:x:{file.stat().st_gid}:\n")
    found = asked(check_permission, owned, stranger(owned))
    assert found.verdict is PROBLEM
    assert "A login console has taken it" in found.sentence
    assert found.cure == ()


def test_users_who_may_open_it(owned):
    file = owned.root / "dev/ttyUSB0"
    member = User(file.stat().st_uid + 1, frozenset({file.stat().st_gid}), "ben")
    assert asked(check_permission, owned, member).verdict is OK


# ---- another process


def test_a_process_that_holds_the_port_is_named(machine):
    machine.usb_serial("ttyUSB0", "1-1", "1a86:7523")
    machine.process(7, "bash", opens="/dev/pts/0")
    machine.process(4711, "minicom", opens="/dev/ttyUSB0")
    found = asked(check_holder, machine)
    assert found.verdict is PROBLEM
    assert found.sentence == "minicom (process 4711) has it open"
    assert found.cure == ("kill 4711",)


def test_a_service_that_holds_the_port_is_stopped_as_a_service(machine):
    machine.usb_serial("ttyUSB0", "1-1", "1a86:7523")
    machine.process(9, "gpsd", opens="/dev/ttyUSB0")
    machine.process(10, "agetty", opens="/dev/ttyUSB0")
    found = asked(check_holder, machine)
    assert found.sentence == "gpsd (process 9) and agetty (process 10) have it open"
    assert found.cure == (
        "sudo systemctl disable --now gpsd.socket gpsd",
        "sudo systemctl disable --now serial-getty@ttyUSB0.service",
    )


def test_a_port_of_a_similar_name_is_not_this_one(machine):
    machine.usb_serial("ttyUSB1", "1-1", "1a86:7523")
    machine.process(4711, "minicom", opens="/dev/ttyUSB10")
    assert asked(check_holder, machine).verdict is OK


def test_processes_that_may_not_be_looked_into_are_counted_but_not_the_kernels(machine):
    machine.usb_serial("ttyUSB0", "1-1", "1a86:7523")
    for pid, command in ((1, "/sbin/init\0"), (2, "")):
        machine.process(pid, "process")
        machine.write(f"proc/{pid}/cmdline", command)
        (machine.root / f"proc/{pid}/fd").rmdir()
        machine.write(f"proc/{pid}/fd")  # no folder: to list it fails, as it does of other users' processes
    found = asked(check_holder, machine)
    assert found.verdict is CANNOT_TELL
    assert found.sentence == "no process that you may look into has it open; into 1 you may not"
    assert found.cure == ("sudo fuser -v /dev/ttyUSB0",)


# ---- consoles


@pytest.fixture
def board(machine):
    machine.uart("ttyAMA0", "amba", "uart-pl011")
    machine.write("sys/class/tty/console/active", "tty1\n")
    return machine


def test_a_port_that_is_no_console(board):
    assert asked(check_console, board).verdict is OK


@pytest.mark.parametrize(
    ("file", "cure"),
    [
        ("boot/firmware/cmdline.txt", ("sudoedit /boot/firmware/cmdline.txt",)),
        ("etc/default/grub", ("sudoedit /etc/default/grub", "sudo update-grub")),
        ("elsewhere", ()),
    ],
)
def test_the_kernels_console(board, file, cure):
    board.write("sys/class/tty/console/active", "tty1 ttyAMA0\n")
    board.write(file)
    found = asked(check_console, board)
    assert found.verdict is PROBLEM
    assert found.sentence == "the kernel writes its messages to it (`console=` on its command line)"
    assert found.cure == cure
    assert found.then.startswith(f"remove `console=ttyAMA0...` {'there' if cure else 'from the kernel'}")


@pytest.mark.parametrize("name", ["ttyAMA0", "serial0"])
def test_the_kernels_console_by_its_command_line(board, name):
    (board.root / "sys/class/tty/console/active").unlink()
    board.write("proc/cmdline", f"root=/dev/mmcblk0p2 console={name},115200 console=tty1 rootwait\n")
    board.link("dev/serial0", "dev/ttyAMA0")
    assert asked(check_console, board).verdict is PROBLEM


def test_another_port_is_the_kernels_console(board):
    board.write("sys/class/tty/console/active", "ttyAMA01\n")
    board.write("proc/cmdline", "console=ttyAMA01\n")
    assert asked(check_console, board).verdict is OK


@pytest.mark.parametrize("folder", ["run/systemd/generator", "etc/systemd/system"])
def test_a_login_that_systemd_starts(board, folder):
    board.link(f"{folder}/getty.target.wants/serial-getty@ttyAMA0.service", "lib/systemd/system/serial-getty@.service")
    found = asked(check_console, board)
    assert found.verdict is PROBLEM
    assert found.sentence == "a login console runs on it and answers the MCU"
    assert found.cure == ("sudo systemctl disable --now serial-getty@ttyAMA0.service",)


def test_a_login_that_is_masked_does_not_count(board):
    board.link("run/systemd/generator/getty.target.wants/serial-getty@ttyAMA0.service", "lib/x")
    (board.root / "etc/systemd/system").mkdir(parents=True)
    (board.root / "etc/systemd/system/serial-getty@ttyAMA0.service").symlink_to("/dev/null")
    assert asked(check_console, board).verdict is OK


@pytest.mark.parametrize("argument", ["ttyAMA0", "/dev/ttyAMA0"])
def test_a_login_that_runs(board, argument):
    board.process(500, "agetty", f"/sbin/agetty -o --keep-baud 115200 {argument} vt220")
    assert asked(check_console, board).verdict is PROBLEM


def test_a_login_on_another_port(board):
    board.process(500, "agetty", "/sbin/agetty ttyAMA01 vt220")
    assert asked(check_console, board).verdict is OK


def test_both_consoles_on_a_jetson(machine):
    machine.uart("ttyTHS1", "platform", "serial-tegra")
    machine.write("sys/class/tty/console/active", "ttyTHS1\n")
    machine.write("boot/extlinux/extlinux.conf")
    machine.process(500, "agetty", "/sbin/agetty ttyTHS1")
    machine.write("etc/systemd/system/multi-user.target.wants/nvgetty.service")
    found = asked(check_console, machine)
    assert ", and a login console runs on it" in found.sentence
    assert found.cure == ("sudoedit /boot/extlinux/extlinux.conf", "sudo systemctl disable --now nvgetty")
    assert found.then == "remove `console=ttyTHS1...` there, and start the computer again"


# ---- ModemManager


def acm(machine, protocol="01", subclass="02"):
    device = machine.usb_device("1-1", "0483:5740", dev="189:4")
    machine.acm("ttyACM0", device, 0, bInterfaceSubClass=subclass, bInterfaceProtocol=protocol)


def test_modem_manager_does_not_run(machine):
    acm(machine)
    assert asked(check_modem_manager, machine).verdict is OK


@pytest.mark.parametrize(("protocol", "verdict"), [("00", OK), ("01", WARNING), ("06", WARNING), ("ff", OK)])
def test_modem_manager_probes_ports_that_declare_at_commands(machine, protocol, verdict):
    acm(machine, protocol)
    machine.process(800, "ModemManager", "/usr/sbin/ModemManager")
    found = asked(check_modem_manager, machine)
    assert found.verdict is verdict
    if verdict is WARNING:
        assert found.cure == (
            """echo 'ATTRS{idVendor}=="0483", ATTRS{idProduct}=="5740", ENV{ID_MM_DEVICE_IGNORE}="1"' """
            "| sudo tee -a /etc/udev/rules.d/78-no-modem.rules",
            "sudo udevadm control --reload && sudo udevadm trigger",
        )


@pytest.mark.parametrize(
    ("command", "verdict"),
    [
        ("ModemManager", OK),
        ("ModemManager --filter-policy=strict", OK),
        ("ModemManager --filter-policy=DEFAULT", WARNING),
        ("ModemManager --debug --filter-policy legacy", WARNING),
    ],
)
def test_modem_manager_probes_adapter_chips_under_other_policies(machine, command, verdict):
    machine.usb_serial("ttyUSB0", "1-1", "1a86:7523")
    machine.process(800, "ModemManager", f"/usr/sbin/{command}")
    assert asked(check_modem_manager, machine).verdict is verdict


@pytest.mark.parametrize("entry", ["c166:0", "c189:4"], ids=["of the port", "of the device"])
def test_a_rule_that_keeps_modem_manager_away_counts(machine, entry):
    acm(machine)
    machine.process(800, "ModemManager", "/usr/sbin/ModemManager --filter-policy=strict")
    machine.write(f"run/udev/data/{entry}", "S:serial/by-id/x\nE:ID_MM_CANDIDATE=1\nE:ID_MM_DEVICE_IGNORE=1\n")
    assert asked(check_modem_manager, machine).verdict is OK


def test_a_rule_that_asks_for_modem_manager_counts(machine):
    machine.usb_serial("ttyUSB0", "1-1", "1a86:7523")
    machine.process(800, "ModemManager")
    machine.write("run/udev/data/c188:0", "E:ID_MM_DEVICE_PROCESS=1\n")
    assert asked(check_modem_manager, machine).verdict is WARNING


def test_modem_manager_leaves_uarts_alone(board):
    board.process(800, "ModemManager")
    assert asked(check_modem_manager, board) is None


# ---- latency timer, power


def test_an_ftdi_adapter_with_its_usual_timer(machine):
    port = machine.usb_serial("ttyUSB0", "1-1", "0403:6001", "ftdi_sio")
    machine.attributes(port, latency_timer="16")
    found = asked(check_latency_timer, machine)
    assert found.verdict is WARNING
    assert "for 16 ms" in found.sentence
    assert found.cure[0] == "echo 1 | sudo tee /sys/bus/usb-serial/devices/ttyUSB0/latency_timer"
    assert (machine.root / "sys/bus/usb-serial/devices/ttyUSB0/latency_timer").exists()
    machine.attributes(port, latency_timer="1")
    assert asked(check_latency_timer, machine).verdict is OK


def test_an_adapter_without_a_timer(machine):
    machine.usb_serial("ttyUSB0", "1-1", "1a86:7523")
    assert asked(check_latency_timer, machine) is None


def test_a_device_that_may_sleep_while_it_is_open(machine):
    device = machine.usb_device("1-1.4", "0483:5740")
    machine.acm("ttyACM0", device)
    assert asked(check_autosuspend, machine).verdict is OK
    machine.attributes(device / "power", control="auto")
    found = asked(check_autosuspend, machine)
    assert found.verdict is WARNING
    assert found.cure[0] == "echo on | sudo tee /sys/bus/usb/devices/1-1.4/power/control"
    assert 'ATTR{idVendor}=="0483"' in found.cure[1]
    assert (machine.root / "sys/bus/usb/devices/1-1.4/power/control").exists()


def test_an_adapter_chip_is_kept_awake_by_its_driver(machine):
    machine.usb_serial("ttyUSB0", "1-1", "1a86:7523")
    control = machine.root / "sys/bus/usb/devices/1-1/power/control"
    control.write_text("auto\n")
    assert asked(check_autosuspend, machine).verdict is OK
    control.unlink()
    assert asked(check_autosuspend, machine).verdict is CANNOT_TELL


# ---- brltty, drivers

RULES = """\
# Device: 1A86:7523
ENV{PRODUCT}=="1a86/7523/*", ENV{BRLTTY_BRAILLE_DRIVER}="bm", GOTO="brltty_usb_run"
ENV{PRODUCT}=="403/6001/*", ATTRS{manufacturer}=="Hedo Reha Technik GmbH", ENV{BRLTTY_BRAILLE_DRIVER}="hd"
# ENV{PRODUCT}=="10c4/ea60/*", ENV{BRLTTY_BRAILLE_DRIVER}="sk"
"""


def test_brltty_has_taken_an_adapter(machine):
    machine.write("usr/lib/udev/rules.d/85-brltty.rules", RULES)
    machine.interface(machine.usb_device("1-1", "1a86:7523", product="USB Serial", bcdDevice="0264"), 0, "usbfs")
    (found,) = check_brltty(Machine(machine.root))
    assert found.verdict is PROBLEM
    assert found.sentence.startswith("brltty has taken USB Serial (1a86:7523) for a braille display")
    assert found.cure == (
        "sudo ln -s /dev/null /etc/udev/rules.d/85-brltty.rules",
        "sudo udevadm control --reload",
    )
    machine.write("usr/bin/apt")
    assert check_brltty(Machine(machine.root))[0].cure == ("sudo apt remove brltty",)


def test_brltty_may_take_an_adapter(machine):
    machine.write("lib/udev/rules.d/90-brltty-usb-generic.rules", RULES)
    machine.usb_serial("ttyUSB0", "1-1", "1a86:7523")
    (found,) = check_brltty(Machine(machine.root))
    assert found.verdict is WARNING
    assert "may take /dev/ttyUSB0 away" in found.sentence


@pytest.mark.parametrize(
    ("ids", "manufacturer", "verdict"),
    [
        ("0403:6001", "Hedo Reha Technik GmbH", WARNING),
        ("0403:6001", "FTDI", OK),
        ("10c4:ea60", "Silicon Labs", OK),
        ("1a86:55d3", "QinHeng", OK),
    ],
)
def test_brlttys_rules_are_read_with_their_conditions(machine, ids, manufacturer, verdict):
    machine.write("usr/lib/udev/rules.d/85-brltty.rules", RULES)
    machine.usb_serial("ttyUSB0", "1-1", ids, manufacturer=manufacturer)
    (found,) = check_brltty(Machine(machine.root))
    assert found.verdict is verdict


def test_rules_of_brltty_that_were_switched_off_do_not_count(machine):
    machine.write("usr/lib/udev/rules.d/85-brltty.rules", RULES)
    machine.usb_serial("ttyUSB0", "1-1", "1a86:7523")
    (machine.root / "etc/udev/rules.d").mkdir(parents=True)
    (machine.root / "etc/udev/rules.d/85-brltty.rules").symlink_to("/dev/null")
    (found,) = check_brltty(Machine(machine.root))
    assert found.verdict is OK


def test_an_adapter_without_a_driver(machine):
    machine.interface(machine.usb_device("1-1", "1a86:7523"), 0)
    machine.interface(
        machine.usb_device("1-2", "0483:5740", product="Arm"), 0, bInterfaceClass="02", bInterfaceSubClass="02"
    )
    machine.interface(machine.usb_device("1-3", "046d:c52b"), 0)
    machine.usb_serial("ttyUSB0", "1-4", "1a86:7523")
    found = check_driver(Machine(machine.root))
    assert [(one.verdict, one.cure) for one in found] == [
        (PROBLEM, ("sudo modprobe ch341",)),
        (PROBLEM, ("sudo modprobe cdc_acm",)),
    ]
    assert found[0].sentence.startswith("CH340 is plugged in (1-1), and no driver has taken it")
    assert found[1].sentence.startswith("Arm (0483:5740) is plugged in (1-2)")


# ---- Linux on Windows


def test_linux_itself_is_no_wsl(machine):
    machine.write("proc/sys/kernel/osrelease", "6.8.0-36-generic\n")
    assert check_wsl(Machine(machine.root)) is None


def test_wsl_2_is_given_devices_by_usbipd(machine):
    machine.write("proc/sys/kernel/osrelease", "5.15.153.1-microsoft-standard-WSL2\n")
    found = check_wsl(Machine(machine.root))
    assert found.verdict is PROBLEM
    assert found.cure[0] == "usbipd list"
    machine.usb_serial("ttyUSB0", "1-1", "1a86:7523", driver="ch341")
    assert check_wsl(Machine(machine.root)).verdict is OK


def test_wsl_1_has_no_usb(machine):
    machine.write("proc/sys/kernel/osrelease", "4.4.0-19041-Microsoft\n")
    found = check_wsl(Machine(machine.root))
    assert found.verdict is WARNING
    assert "WSL 1" in found.sentence
