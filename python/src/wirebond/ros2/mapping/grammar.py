"""The syntax of a mapping file: the keys with their places and values. Their meaning is in `reader`."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from pydantic import Field, PlainValidator, WithJsonSchema

from wirebond.protocol.text.scalars import Bool, Duration, Name, Period, Text, describe, one_word, whole, wrong
from wirebond.protocol.text.wording import Syntax
from wirebond.protocol.text.yaml_tree import Number
from wirebond.ros2.node import NAMESPACE, TOPIC
from wirebond.ros2.types import SERVICE_NAMES

_PATH = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(\.[A-Za-z0-9_]+)*")
_NODE = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def _matching(pattern: re.Pattern[str], what: str) -> Any:
    def validate(value: object) -> str:
        if not isinstance(value, str) or not pattern.fullmatch(value):
            raise wrong(f"{describe(value)} is not {what}")
        return value

    return PlainValidator(validate, json_schema_input_type=Annotated[str, Field(pattern=f"^({pattern.pattern})$")])


Topic = Annotated[str, _matching(TOPIC, "a topic; write letters, digits, `_` and `/`, such as `cmd_vel` or `/odom`")]
Namespace = Annotated[str, _matching(NAMESPACE, "a namespace; write `/`, or names such as `/robot1`")]
NodeName = Annotated[str, _matching(_NODE, "a node's name; write letters, digits and `_`, such as `rover`")]


@dataclass(frozen=True)
class Source:
    """The source of a value.

    :ivar path: a field of the other side, as ``state.estop``; empty: ``constant`` is the value.
    :ivar choose: the replacement of each of its values; empty: the value itself.
    """

    path: str = ""
    constant: float | int | bool | str | None = None
    scale: float = 1.0
    offset: float = 0.0
    choose: dict[str, float | int | bool | str] = field(default_factory=dict)


def _plain_number(value: object) -> float:
    if not isinstance(value, Number) or not math.isfinite(value.value):
        raise wrong(f"{describe(value)} is not a number; write a decimal, such as 0.01")
    return float(value.value)


def _choice(value: object) -> float | int | bool | str:
    if isinstance(value, Number):
        return value.value
    if isinstance(value, bool | str):
        return value
    raise wrong(f"{describe(value)} is not possible here; write a number, true, false, or a constant's name")


def _source(value: object) -> Source:
    if isinstance(value, bool):
        return Source(constant=value)
    if isinstance(value, Number):
        return Source(constant=value.value)
    if isinstance(value, str) and _PATH.fullmatch(value):
        return Source(path=value)
    if isinstance(value, dict) and set(value) == {"text"} and isinstance(value["text"], str):
        return Source(constant=value["text"])
    if isinstance(value, dict) and "from" in value and set(value) <= {"from", "scale", "offset", "values"}:
        path, choose = value["from"], value.get("values", {})
        if not isinstance(path, str) or not _PATH.fullmatch(path):
            raise wrong(f"{describe(path)} is not a field; write its name, such as `state.estop`")
        if not isinstance(choose, dict) or (choose and len(value) > 2):
            raise wrong("`values` needs `from` and nothing else; write `{from: state.on, values: {true: 1, false: 0}}`")
        scale, offset = (_plain_number(value[key]) if key in value else float(key == "scale") for key in _LINEAR)
        return Source(path, None, scale, offset, {key: _choice(one) for key, one in choose.items()})
    raise wrong(
        f"{describe(value)} is not a source of a value; write a field such as `battery` or `state.estop`, a number, "
        'true or false, `{text: "a text"}`, or `{from: battery, scale: 0.1}`'
    )


_LINEAR = ("scale", "offset")
_PATH_SCHEMA = {"type": "string", "pattern": f"^{_PATH.pattern}$"}
_SOURCE_SCHEMA: dict[str, Any] = {
    "description": "Where the value comes from.",
    "anyOf": [
        {**_PATH_SCHEMA, "description": "A field, such as `battery`, `state.estop` or `q.0`."},
        {"type": ["number", "boolean"], "description": "This value, always."},
        {
            "type": "object",
            "properties": {"text": {"type": "string", "description": "This text, always."}},
            "required": ["text"],
            "additionalProperties": False,
        },
        {
            "type": "object",
            "properties": {
                "from": {**_PATH_SCHEMA, "description": "A field, such as `battery`, `state.estop` or `q.0`."},
                "scale": {"type": "number", "description": "The value is multiplied by this."},
                "offset": {"type": "number", "description": "This is added then."},
                "values": {
                    "type": "object",
                    "additionalProperties": {"type": ["number", "boolean", "string"]},
                    "description": "A value for each name of an enum, or for true and false.",
                },
            },
            "required": ["from"],
            "additionalProperties": False,
        },
    ],
}
SourceValue = Annotated[Source, PlainValidator(_source), WithJsonSchema(_SOURCE_SCHEMA, mode="validation")]
Amount = Annotated[float, PlainValidator(_plain_number, json_schema_input_type=float)]
_MOST_KEPT = 10_000
Depth = Annotated[
    int,
    PlainValidator(whole(1, _MOST_KEPT), json_schema_input_type=Annotated[int, Field(ge=1, le=_MOST_KEPT)]),
]


def _positive(value: object) -> float:
    number = _plain_number(value)
    if number <= 0:
        raise wrong(f"{describe(value)} is not more than 0; write the size of the real robot")
    return number


Size = Annotated[float, PlainValidator(_positive, json_schema_input_type=Annotated[float, Field(gt=0)])]


class QosSyntax(Syntax):
    noun = "a quality of service"

    reliability: Annotated[str, one_word("reliable", "best_effort")] = Field(
        "reliable", description="Whether data that the network loses is sent again.", examples=["best_effort"]
    )
    durability: Annotated[str, one_word("volatile", "transient_local")] = Field(
        "volatile", description="transient_local: late subscribers get the last messages.", examples=["volatile"]
    )
    depth: Depth = Field(10, description="How many messages are kept.", examples=[10])


class PublishSyntax(Syntax):
    noun = "an entry of `publish`"

    message: Name = Field(description="A message of the MCU.", examples=["status"])
    topic: Topic = Field(description="Where it appears.", examples=["battery_state"])
    type: Text = Field(description="The topic's message type.", examples=["sensor_msgs/BatteryState"])
    fields: dict[str, SourceValue] | None = Field(
        None, description="Each field of the topic, and where it comes from. The message's own type needs none."
    )
    frame: Text = Field("", description="frame_id of its headers.", examples=["base_link"])
    child_frame: Text = Field("", description="child_frame_id of its transforms.", examples=["gimbal"])
    at_most: Period | None = Field(None, description="Publish no faster than this.", examples=["10 Hz"])
    qos: QosSyntax | None = Field(None, description="Quality of service.", examples=[{"reliability": "best_effort"}])


class SubscribeSyntax(Syntax):
    noun = "an entry of `subscribe`"

    topic: Topic = Field(description="Where commands come from.", examples=["cmd_vel"])
    type: Text = Field(description="The topic's message type.", examples=["geometry_msgs/Twist"])
    message: Name = Field(description="The message of the host that they become.", examples=["velocity"])
    fields: dict[str, SourceValue] | None = Field(
        None, description="Each field of the message, and where it comes from. The message's own type needs none."
    )
    stale: Duration | None = Field(
        None,
        description="Repeat the last command at the message's `every`, for this time after it came. Without it each "
        "command is sent once.",
        examples=["500 ms"],
    )
    qos: QosSyntax | None = Field(None, description="Quality of service.", examples=[{"reliability": "best_effort"}])


class ServiceSyntax(Syntax):
    noun = "an entry of `services`"

    service: Topic = Field(description="Its name.", examples=["motors_enabled"])
    type: Annotated[str, one_word(*SERVICE_NAMES)] = Field(
        description="The service's type.", examples=["std_srvs/SetBool"]
    )
    message: Name | None = Field(None, description="The message of the host that a call sends.", examples=["enable"])
    fields: dict[str, SourceValue] = Field({}, description="Each field of the message, and where it comes from.")
    answer: dict[str, SourceValue] = Field(
        {},
        description="`success` and `message` of the response, and where in the reply they come from. Default: any "
        "reply is a success.",
    )
    timeout: Duration | None = Field(None, description="How long a reply may take. Default: 1 s", examples=["500 ms"])
    recover: Name | None = Field(
        None,
        description="In the place of a message: a deadline of the host with `recover: explicit`, which a call ends.",
        examples=["stop_navigation"],
    )


class OdometrySyntax(Syntax):
    noun = "`odometry`"

    message: Name = Field(description="The message with the ticks since the one before.", examples=["odometry"])
    left: Name = Field(description="Its field for the left wheel.", examples=["left_ticks"])
    right: Name = Field(description="Its field for the right wheel.", examples=["right_ticks"])
    wheel_radius: Size = Field(description="Metres.", examples=[0.0325])
    wheel_separation: Size = Field(description="Metres between the wheels.", examples=[0.30])
    ticks_per_turn: Size = Field(description="Encoder ticks of one turn of a wheel.", examples=[1024])
    frame: Text = Field("odom", description="Frame that the pose is in.", examples=["odom"])
    child_frame: Text = Field("base_link", description="Frame of the robot.", examples=["base_link"])
    topic: Topic = Field("odom", description="Topic of nav_msgs/Odometry.", examples=["odom"])
    tf: Bool = Field(True, description="Whether the pose is published on /tf, too.", examples=[True])
    reset: Topic | None = Field(
        None, description="A service of std_srvs/Trigger that sets the pose to zero.", examples=["reset_odometry"]
    )
    joints: list[Text] = Field(
        [], description="Names of the left and the right joint, for joint_states.", examples=[["left", "right"]]
    )
    pose_deviation: list[Amount] = Field(
        [0.05, 0.05, 0.1], description="Standard deviations of x and y (m) and of the heading (rad)."
    )
    twist_deviation: list[Amount] = Field(
        [0.02, 0.05], description="Standard deviations of the speed (m/s) and of the turn rate (rad/s)."
    )


class FlagsSyntax(Syntax):
    noun = "an entry of `diagnostics`"

    message: Name = Field(description="A message of the MCU.", examples=["status"])
    field: Name = Field(description="A field with flags; each flag that is set is an error.", examples=["errors"])
    words: dict[str, Text] = Field({}, description="The meaning of a flag, in words.")


class NavigationSyntax(Syntax):
    noun = "`navigation`"

    deadline: Name = Field(description="The deadline of the host that stops navigation.", examples=["stop_navigation"])
    cancel: list[Topic] = Field(
        ["navigate_to_pose"],
        description="Actions whose goals are cancelled then, over rclpy.",
        examples=[["navigate_to_pose"]],
    )
    topic: Topic = Field("navigation_ok", description="Latched std_msgs/Bool.", examples=["navigation_ok"])


class File(Syntax):
    """A mapping file."""

    noun = "a mapping file"

    wirebond_ros2: Annotated[int, PlainValidator(whole(1, 1), json_schema_input_type=Literal[1])] = Field(
        description="Version of this grammar.", examples=[1]
    )
    node: NodeName | None = Field(None, description="The node's name. Default: the protocol's.", examples=["rover"])
    namespace: Namespace = Field("/", description="The node's namespace.", examples=["/robot1"])
    json_topics: Annotated[str, one_word("unmapped", "all", "none")] = Field(
        "unmapped", description="Which messages also have topics with JSON.", examples=["all"]
    )
    typed_topics: Annotated[str, one_word("unmapped", "all", "none")] = Field(
        "none",
        description="Which messages have topics of the types of `wirebond gen --lang ros2`, and none with JSON.",
        examples=["unmapped"],
    )
    serial: Bool = Field(False, description="Whether frames have topics, as bytes and in hex.", examples=[True])
    publish: list[PublishSyntax] = Field([], description="Messages of the MCU that become typed topics.")
    subscribe: list[SubscribeSyntax] = Field([], description="Topics that become messages of the host.")
    services: list[ServiceSyntax] = Field([], description="Services that become messages of the host.")
    odometry: OdometrySyntax | None = Field(None, description="The pose of a robot with two driven wheels.")
    poll: list[Name] = Field([], description="Requests that are repeated at their `every`.", examples=[["query"]])
    diagnostics: list[FlagsSyntax] = Field([], description="Flags that /diagnostics names.")
    navigation: NavigationSyntax | None = Field(None, description="What stops navigation.")
    latency: Topic | None = Field(
        None,
        description="A std_msgs/Float64, once a second: how old messages are when they become topics.",
        examples=["latency"],
    )
    emergency_stop: Topic | None = Field(
        None, description="A std_msgs/Bool: true stops, false releases.", examples=["emergency_stop"]
    )
    recover: Topic = Field(
        "~/recover",
        description="A std_msgs/Empty that ends deadlines at the MCU with `recover: explicit` by their `recover_by`.",
        examples=["recover"],
    )
