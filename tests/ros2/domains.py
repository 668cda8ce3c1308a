"""ROS domains for tests: a process that asks gets one that no other process of this computer has."""

from __future__ import annotations

import socket
from functools import cache

_FIRST, _LAST = 1, 100  # the ports of larger numbers are those that the system gives to any program


@cache
def own_domain() -> int:
    """The domain of this process, until it ends. An abstract socket claims it, so a kill frees it, too."""
    for number in range(_FIRST, _LAST + 1):
        claim = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            claim.bind(f"\0wirebond test, ROS domain {number}")
        except OSError:
            claim.close()
            continue
        _claims.append(claim)
        return number
    raise AssertionError("other tests on this computer have all domains")


_claims: list[socket.socket] = []
