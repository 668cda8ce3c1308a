"""Services over DDS, as rmw_cyclonedds has them: in front of each request and response stand 16 bytes, which tell whose
request it is and its number, and come back with the response. Who else speaks to them gets no answer.

Fast DDS carries the same in fields of the network protocol (inline QoS), which DDS for Python neither reads nor writes:
its request is shorter by these bytes. The layout is that of `cdds_request_header_t` in rmw_cyclonedds_cpp of Jazzy, and
user data `serviceid`, `clientid` let both sides find the two topics of one service.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from cyclonedds.core import Policy
from cyclonedds.idl import IdlStruct, make_idl_struct, types
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader

from wirebond.ros2.node import Answer
from wirebond.ros2.types import Kind, RosField, RosType

RMW = "rmw_cyclonedds_cpp"
_NUMBERS = ("client", "number")
_AT_ONCE = 4  # calls that are answered at the same time
_MATCH = 0.1  # seconds that a response waits until its reader is found, as rmw_cyclonedds waits
_LOOK = 0.01


def are_possible() -> bool:
    """Do the programs of this network speak services as this file does? The user says so, as to ROS."""
    return os.environ.get("RMW_IMPLEMENTATION") == RMW


def numbered(type_: RosType) -> RosType:
    """Return a request or a response with the bytes in front, under its own name. They are 16, so fields stay
    aligned."""
    numbers = [RosField(name, Kind.ONE, base, None) for name, base in zip(_NUMBERS, ("uint64", "int64"), strict=True)]
    return RosType(type_.name, (*numbers, *type_.fields), type_.constants, type_.store)


def any_bytes(type_: RosType) -> type[IdlStruct]:
    """Return the declaration of a topic that carries requests or responses of this type. DDS compares names, and drops
    what is shorter than its declaration; so this one is short, and whoever calls in another form is seen."""
    return make_idl_struct(type_.name.replace("/", "_"), type_.dds_name.replace("::", "."), {"octet": types.uint8})


class Calls:
    """Answers requests in threads of its own."""

    def __init__(self, fail: Callable[[str], None]) -> None:
        """``fail``: takes the sentence for an answer that could not be made."""
        self._pool = ThreadPoolExecutor(_AT_ONCE, "ROS 2 services")
        self._fail = fail

    def taker(
        self, requests: DataReader[Any], responses: DataWriter[Any], answer: Answer, respond: Callable[[Any], None]
    ) -> Callable[[dict[str, Any]], None]:
        """Return a function that takes the requests of one service, each with its number."""

        def call(request: dict[str, Any]) -> None:
            numbers = {name: request[name] for name in _NUMBERS}
            try:
                response = answer({name: value for name, value in request.items() if name not in _NUMBERS})
                _wait_for_clients(requests, responses)
                respond(numbers | response)
            except Exception as error:
                self._fail(f"a request could not be answered: {error!r}")
                raise

        def take(request: dict[str, Any]) -> None:
            self._pool.submit(call, request)

        return take

    def close(self) -> None:
        """Stop answering."""
        self._pool.shutdown(wait=False, cancel_futures=True)


def _wait_for_clients(requests: DataReader[Any], responses: DataWriter[Any]) -> None:
    """Wait until every program that may ask can hear the response: an earlier one would be lost."""
    end = time.monotonic() + _MATCH
    while time.monotonic() < end:
        asking = {_client(requests.get_matched_publication_data(one)) for one in requests.get_matched_publications()}
        hearing = {
            _client(responses.get_matched_subscription_data(one)) for one in responses.get_matched_subscriptions()
        }
        if asking - {""} <= hearing:
            return
        time.sleep(_LOOK)


def _client(endpoint: Any) -> str:
    """Return the ``clientid`` of an endpoint; empty: it has none, or is gone."""
    policies = () if endpoint is None else endpoint.qos
    data = next((policy.data for policy in policies if isinstance(policy, Policy.Userdata)), b"")
    pairs = (pair.partition("=") for pair in data.decode(errors="replace").split(";"))
    return next((value for key, _, value in pairs if key == "clientid"), "")
