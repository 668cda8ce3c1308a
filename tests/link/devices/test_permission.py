"""The group that a user must join is that of the device, and nothing is advised that would not help."""

from __future__ import annotations

import os

import pytest

from wirebond.chinese import chinese
from wirebond.link.devices import group_of, no_permission
from wirebond.link.devices.permission import Refusal, User, permission, port_group


@pytest.fixture
def device(machine):
    """A port of the group uucp: mode 0660, of another user."""
    file = machine.write("dev/ttyUSB0")
    file.chmod(0o660)
    if os.geteuid() == 0:
        os.chown(file, 1, 14)
    status = file.stat()
    machine.write("etc/group", f"root:x:0:\nuucp:x:{status.st_gid}:ben\nvideo:x:{status.st_gid + 1}:ana\n")
    machine.write("etc/passwd", f"root:x:0:0::/:\nowner:x:{status.st_uid}:1::/:\n")
    return file


def user(device, name="ana", member=False):
    status = device.stat()
    return User(status.st_uid + 1, frozenset({status.st_gid if member else status.st_gid + 1}), name)


def test_a_user_outside_the_group_learns_its_name(machine, device):
    assert permission("/dev/ttyUSB0", machine.root, user(device)).refusal is Refusal.NOT_A_MEMBER
    assert no_permission("/dev/ttyUSB0", machine.root, user(device)) == (
        "no permission to open /dev/ttyUSB0; join its group with `sudo usermod -aG uucp $USER`, then log in again"
    )


def test_a_member_may_open_it(machine, device):
    assert permission("/dev/ttyUSB0", machine.root, user(device, member=True)).refusal is None


def test_a_user_who_joined_since_the_session_began_must_log_in_again(machine, device):
    assert permission("/dev/ttyUSB0", machine.root, user(device, "ben")).refusal is Refusal.OLD_SESSION
    assert no_permission("/dev/ttyUSB0", machine.root, user(device, "ben")) == (
        "no permission to open /dev/ttyUSB0; you are in its group uucp, but were not when this session began: "
        "log in again"
    )


@pytest.mark.parametrize("mode", [0o600, 0o620, 0o640])
def test_where_the_group_may_not_either_joining_it_is_not_advised(machine, device, mode):
    device.chmod(mode)
    for member in (False, True):
        who = user(device, member=member)
        assert permission("/dev/ttyUSB0", machine.root, who).refusal is Refusal.GROUP_MAY_NOT
        assert "usermod" not in no_permission("/dev/ttyUSB0", machine.root, who)
    assert "owner uucp has no group with access; `wirebond doctor /dev/ttyUSB0` shows the remedy" in no_permission(
        "/dev/ttyUSB0", machine.root, user(device)
    )


def test_to_join_the_group_of_root_is_not_advised(machine, device, monkeypatch):
    machine.write("etc/group", "root:x:0:\n")
    status = list(device.stat())
    status[5] = 0  # the group's number
    monkeypatch.setattr(type(device), "stat", lambda path, **options: os.stat_result(status))
    ana = User(status[4] + 1, frozenset(), "ana")
    assert permission("/dev/ttyUSB0", machine.root, ana).refusal is Refusal.GROUP_MAY_NOT


def test_owner_and_others_have_their_own_bits(machine, device):
    device.chmod(0o606)
    assert permission("/dev/ttyUSB0", machine.root, user(device)).refusal is None
    device.chmod(0o600)
    owner = User(device.stat().st_uid, frozenset(), "owner")
    assert permission("/dev/ttyUSB0", machine.root, owner).refusal is None


def test_a_group_without_a_name_is_its_number(machine, device):
    machine.write("etc/group", "root:x:0:\nbroken line\n")
    assert group_of("/dev/ttyUSB0", machine.root) == str(device.stat().st_gid)


def test_a_device_that_is_gone_has_no_group_and_still_a_sentence(machine):
    assert group_of("/dev/ttyUSB0", machine.root) is None
    assert no_permission("/dev/ttyUSB0", machine.root) == (
        "no permission to open /dev/ttyUSB0; `wirebond doctor /dev/ttyUSB0` looks for the reason"
    )


def test_a_refusal_that_the_mode_allows_is_not_blamed_on_a_group(machine, device):
    sentence = no_permission("/dev/ttyUSB0", machine.root, user(device, member=True))
    assert "something else forbids it, such as the rules of a container" in sentence


@pytest.mark.parametrize(
    ("groups", "name"),
    [("plugdev:x:46:\ndialout:x:20:\n", "dialout"), ("uucp:x:14:\n", "uucp"), ("root:x:0:\n", "dialout")],
)
def test_the_group_for_serial_ports_is_that_of_the_distribution(machine, groups, name):
    machine.write("etc/group", groups)
    assert port_group(machine.root) == name


def test_the_real_system_is_asked_about_this_process():
    assert permission("/dev/null").refusal is None


def test_each_sentence_has_a_chinese_one(machine, device):
    said = [no_permission("/dev/ttyUSB0", machine.root, user(device, name)) for name in ("ana", "ben")]
    said += [no_permission("/dev/ttyUSB0", machine.root, user(device, member=True))]
    device.chmod(0o600)
    said += [no_permission("/dev/ttyUSB0", machine.root, user(device)), no_permission("/dev/ttyUSB1", machine.root)]
    assert len(set(said)) == 5
    assert [sentence for sentence in said if "没有权限打开 /dev/ttyUSB" not in (chinese(sentence) or "")] == []
