"""Determines who may open a port's device, and which group a user must join. Reads the system, and changes nothing."""

from __future__ import annotations

import contextlib
import os
import stat
import sys
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from wirebond.link.devices import sysfs


@dataclass(frozen=True)
class User:
    """Whose rights are asked about: those of a process, which it got when its session began."""

    uid: int
    groups: frozenset[int]
    name: str


class Refusal(Enum):
    """Why a user may not read and write a device."""

    NOT_A_MEMBER = "not a member"  # the group may, and the user is not in it
    OLD_SESSION = "old session"  # the user is in the group by now, but was not when the session began
    GROUP_MAY_NOT = "group may not"  # joining the group would not help


@dataclass(frozen=True)
class Permission:
    """``refusal`` is None if the user may read and write. ``mode`` is written as ``ls`` does."""

    refusal: Refusal | None
    owner: str
    group: str
    mode: str


def current_user() -> User:
    """Return the user of this process."""
    if sys.platform == "win32":
        return User(-1, frozenset(), os.environ.get("USERNAME", ""))
    return User(os.getuid(), frozenset({os.getgid(), *os.getgroups()}), os.environ.get("USER", ""))


def permission(path: str, root: Path = Path("/"), user: User | None = None) -> Permission | None:
    """Return the rights of `user` (default: this process) on the device `path`, or None if it does not exist.

    Rights beside owner, group and mode (ACLs, as systemd gives them to who sits at the screen) count only where it is
    this process that is asked about, on the real file system.
    """
    try:
        status = sysfs.below(root, path).stat()
    except OSError:
        return None
    who = user or current_user()
    groups = _groups(root)
    group = groups.get(status.st_gid) or _Group(_system_group(root, status.st_gid), frozenset())
    return Permission(
        refusal=None if _may(status, who, root, path, user is None) else _refusal(status, who, group),
        owner=_user_names(root).get(status.st_uid, f"user {status.st_uid}"),
        group=group.name,
        mode=stat.filemode(status.st_mode),
    )


def group_of(path: str, root: Path = Path("/")) -> str | None:
    """Return the name of the group that the device belongs to; None if the device is not there."""
    found = permission(path, root)
    return None if found is None else found.group


def no_permission(path: str, root: Path = Path("/"), user: User | None = None) -> str:
    """Return the sentence for a port that could not be opened for want of rights: what to do, with the device's real
    group."""
    found = permission(path, root, user)
    said = f"no permission to open {path}; "
    if found is None:
        return said + f"`wirebond doctor {path}` looks for the reason"
    if found.refusal is Refusal.NOT_A_MEMBER:
        return said + f"join its group with `sudo usermod -aG {found.group} $USER`, then log in again"
    if found.refusal is Refusal.OLD_SESSION:
        return said + f"you are in its group {found.group}, but were not when this session began: log in again"
    if found.refusal is Refusal.GROUP_MAY_NOT:
        return said + (
            f"{found.mode} {found.owner} {found.group} has no group with access; `wirebond doctor {path}` shows the "
            "remedy"
        )
    return said + "its owner, group and mode allow it, so something else forbids it, such as the rules of a container"


def port_group(root: Path = Path("/")) -> str:
    """Return the group that this system has for serial ports: dialout (Debian, Fedora), uucp (Arch) or another."""
    names = {group.name for group in _groups(root).values()}
    return next((name for name in ("dialout", "uucp", "plugdev") if name in names), "dialout")


@dataclass(frozen=True)
class _Group:
    name: str
    members: frozenset[str]


def _groups(root: Path) -> dict[int, _Group]:
    found: dict[int, _Group] = {}
    for line in (sysfs.text(root / "etc/group") or "").splitlines():
        name, _, number, members = [*line.split(":"), "", "", "", ""][:4]
        if number.isdigit():
            found.setdefault(int(number), _Group(name, frozenset(members.split(","))))
    return found


def _user_names(root: Path) -> dict[int, str]:
    rows = [line.split(":") for line in (sysfs.text(root / "etc/passwd") or "").splitlines()]
    return {int(row[2]): row[0] for row in rows if len(row) > 2 and row[2].isdigit()}


def _system_group(root: Path, gid: int) -> str:
    """Return a group that a directory service knows, or its number."""
    if root == Path("/") and sys.platform != "win32":
        import grp  # noqa: PLC0415 seldom needed, and Windows has none

        with contextlib.suppress(KeyError):
            return grp.getgrgid(gid).gr_name
    return str(gid)


def _may(status: os.stat_result, user: User, root: Path, path: str, is_this_process: bool) -> bool:
    if root == Path("/") and is_this_process:
        return os.access(path, os.R_OK | os.W_OK)
    if user.uid == 0:
        return True
    shift = 6 if user.uid == status.st_uid else 3 if status.st_gid in user.groups else 0
    return (status.st_mode >> shift) & 0o6 == 0o6


def _refusal(status: os.stat_result, user: User, group: _Group) -> Refusal | None:
    if status.st_gid == 0 or (status.st_mode >> 3) & 0o6 != 0o6:
        return Refusal.GROUP_MAY_NOT
    if status.st_gid in user.groups:
        return None  # the mode allows it: something else forbids it
    return Refusal.OLD_SESSION if user.name and user.name in group.members else Refusal.NOT_A_MEMBER
