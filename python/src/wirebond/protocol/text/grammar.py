"""The syntax of a protocol file, as models: the keys and their places, their values, and their purpose.

The descriptions are published in the JSON Schema. What keys mean together is not validated here (see ``frames``,
``messages`` and ``references``).
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, ConfigDict, Discriminator, Field, PlainValidator, Tag

from wirebond.protocol.model import MAX_LATENCY
from wirebond.protocol.text.envelope_grammar import Part
from wirebond.protocol.text.field_grammar import Fields, FieldSyntax
from wirebond.protocol.text.frame_grammar import MAX_PARTS
from wirebond.protocol.text.matching import Ids, MatchValue
from wirebond.protocol.text.scalars import (
    Baud,
    Bool,
    Duration,
    FieldPath,
    FrameBytes,
    GivenValue,
    Name,
    NameText,
    PayloadBytes,
    Period,
    ProtocolName,
    StopBits,
    Text,
    ValuesOrOne,
    describe,
    in_schema,
    one_word,
    whole,
    wrong,
)
from wirebond.protocol.text.wording import Syntax
from wirebond.protocol.text.yaml_tree import Number

# ---- link ----------------------------------------------------------------------------------------


def _data_bits(value: object) -> int:
    if whole(5, 9)(value) != 8:
        raise wrong(f"{describe(value)} data bits cannot carry frames, which are bytes of 8 bits; write 8")
    return 8


MAX_AGE = 30.0  # seconds: range of the 16-bit millisecond stamp of a queued frame, with a margin for late reads


def _max_age(seconds: float) -> float:
    if not 0.001 <= seconds <= MAX_AGE:
        raise wrong(f"frames can wait for 1 ms to {MAX_AGE:g} s; without `max_age` they wait as long as it takes")
    return seconds


def _latency(seconds: float) -> float:
    if seconds > MAX_LATENCY:
        raise wrong(f"a port holds bytes back for {MAX_LATENCY:g} s at most; write less, such as 16 ms")
    return seconds


class Link(Syntax):
    """Settings of the serial line."""

    noun = "`link`"

    baud: Baud = Field(115200, description="Bits a second on the line.", examples=[115200])
    data_bits: Annotated[int, PlainValidator(_data_bits, json_schema_input_type=Literal[8])] = Field(
        8, description="Data bits of a byte.", examples=[8]
    )
    parity: Annotated[str, one_word("none", "even", "odd")] = Field(
        "none", description="Parity bit of a byte.", examples=["none"]
    )
    stop_bits: StopBits = Field(1, description="Stop bits of a byte: 1, 1.5 or 2.", examples=[1])
    max_run: Duration = Field(
        0.001,
        description="Frames that the MCU hands to the line at once take no longer than this, unless it is one. An "
        "urgent frame waits for them.",
        examples=["1 ms"],
    )
    max_age: Annotated[Duration, AfterValidator(_max_age)] | None = Field(
        None,
        description="Frames that waited longer than this expire, at the MCU and in the host's link.",
        examples=["100 ms"],
    )
    echo: Bool = Field(
        False,
        description="An end hears its own bytes, as on two-wire RS-485. It drops them, and counts frames that come "
        "back altered as collisions.",
        examples=["true"],
    )
    adapter_latency: Annotated[Duration, AfterValidator(_latency)] | None = Field(
        None,
        description="How long the host's port may hold back received bytes. Default: 16 ms for USB, else the time "
        "that a UART's buffer takes to fill.",
        examples=["16 ms"],
    )
    on_mismatch: Annotated[str, one_word("hold_back", "act")] = Field(
        "hold_back",
        description="Commands from a host whose hello contains another protocol hash: the MCU holds them back, or "
        "acts on them. The emergency stop always acts.",
        examples=["act"],
    )


# ---- messages ------------------------------------------------------------------------------------


class MessageHead(Syntax):
    """The properties of a message, without its fields."""

    noun = "a message"

    id: Ids | None = Field(
        None,
        description="Number on the wire; decimal or 0x... Several: a list, a range or a mask.",
        examples=["0x01", "[0x10, 0x11]", "0x80..0xFF", "{mask: 0x80, value: 0x80}"],
    )
    match: dict[FieldPath, MatchValue] = Field(
        default_factory=dict,
        description="What identifies its frames besides the id, or instead of one: a value, a list, a range or a "
        "mask, for a header field, for a number of its payload (within a struct by its path, such as `head.kind`), or "
        "for `size` (payload bytes).",
        examples=["{kind: reply, size: 8}", "{head.kind: 1}"],
    )
    sender: Annotated[str, one_word("host", "mcu", "both")] = Field(description="Who sends it.", examples=["host"])
    every: Period | None = Field(None, description="How often it is due: a period or a rate.", examples=["50 ms"])
    reply: Name | None = Field(None, description="The message that answers it.", examples=["status"])
    seed: Annotated[
        int | None,
        PlainValidator(whole(0, 255), json_schema_input_type=Annotated[int, Field(ge=0, le=255)]),
    ] = Field(None, description="Byte that a check with `seed: message` includes after its range.", examples=[50])
    queue: Annotated[str, one_word("normal", "urgent", "latest")] = Field(
        "normal",
        description="How it waits for the line: in turn, before all others (at the MCU), or only the newest one.",
        examples=["latest"],
    )
    log: Text | None = Field(
        None,
        description="The message is a log line of the MCU: this text, which the host shows, with values for `{field}`.",
        examples=['"motor {motor} is too hot: {temperature} °C"'],
    )
    level: Annotated[str | None, one_word("debug", "info", "warning", "error")] = Field(
        None, description="How severe the log line is. Default: `info`.", examples=["warning"]
    )
    description: Text = Field("", description="For people.", examples=["what it is for"])


class MessageSyntax(MessageHead):
    """A named, typed payload."""

    fields: dict[Name, FieldSyntax] = Field(
        default_factory=dict, description="Its values, in wire order.", examples=["{speed: {type: i16}}"]
    )


# ---- behaviour -----------------------------------------------------------------------------------


class GivenMessageSyntax(Syntax):
    """A message of the host, with the values of its fields."""

    model_config = ConfigDict(extra="allow")
    noun = "a message with its values"
    __pydantic_extra__: dict[str, GivenValue]

    message: Name = Field(
        description="The message to send, with the values of its fields: a list for arrays, groups and flags, a "
        "mapping for structs and bits, hex digits in quotes for byte strings.",
        examples=["velocity"],
    )
    fields: dict[Name, GivenValue] = Field(
        default_factory=dict,
        description="Values of its fields, for those that are called `message`, `fields` or `header`.",
        examples=["{message: 0}"],
    )
    header: ValuesOrOne = Field(
        default_factory=dict,
        description="Values of the frame's own named fields, where they differ from their defaults. A single value is "
        "that of the message's field `header`.",
        examples=["{servo: 0xFE}"],
    )


class StopMessageSyntax(GivenMessageSyntax):
    """A message of the emergency stop."""

    noun = "a message of `emergency_stop`"


class RecoverMessageSyntax(GivenMessageSyntax):
    """The message that ends a deadline."""

    noun = "the message of `recover_by`"


class DeadlineSyntax(Syntax):
    """The action when a message stays away."""

    noun = "a deadline"

    message: Name = Field(description="The message that must not stay away.", examples=["velocity"])
    at: Annotated[str, one_word("host", "mcu")] = Field(
        description="The end that watches: its receiver.", examples=["mcu"]
    )
    after: Duration = Field(description="Silence that is too long.", examples=["1 s"])
    then: Name = Field(description="Name of the action.", examples=["stop"])
    recover: Annotated[str, one_word("next_message", "explicit")] = Field(
        "next_message",
        description="How it ends: by the next message, or by an explicit call.",
        examples=["explicit"],
    )
    start: Annotated[str, one_word("ready", "held")] = Field(
        "ready",
        description="After the MCU's start, with `recover: explicit`: the message acts, or it is held back as if the "
        "deadline had struck.",
        examples=["held"],
    )
    recover_by: RecoverMessageSyntax | None = Field(
        None,
        description="The message that the host sends to end it, with the values of its fields, if `recover` is "
        "`explicit`. For people and the console; your firmware calls `recover` when it arrives.",
        examples=["{message: parameter, name: clear_safe_mode, value: 0}"],
    )


def _one_or_list(value: object) -> str:
    return "emergency_stop" if isinstance(value, list) else "[one]"  # also places in an error's location


EmergencyStopSyntax = Annotated[
    Annotated[StopMessageSyntax, Tag("[one]")]
    | Annotated[list[StopMessageSyntax], Field(min_length=1), Tag("emergency_stop")],
    Discriminator(_one_or_list),
]


class ExampleSyntax(Syntax):
    """A worked example: a message's values and the frame that carries them."""

    noun = "an example"

    message: Name = Field(description="The message that the frame carries.", examples=["velocity"])
    sender: Annotated[str | None, one_word("host", "mcu")] = Field(
        None, description="The sender; needed only if both ends send it and it matters.", examples=["host"]
    )
    fields: dict[Name, GivenValue] = Field(
        default_factory=dict,
        description="The values of its fields; a list for arrays and flags, hex digits for byte strings.",
        examples=["{linear: 0.5, angular: 0}"],
    )
    header: dict[Name, GivenValue] = Field(
        default_factory=dict,
        description="Values of the frame's own named fields and numbers, if they differ from their defaults.",
        examples=["{sequence: 5}"],
    )
    bytes: FrameBytes = Field(
        description="The whole frame on the wire, two hex digits a byte.", examples=['"AA 55 01"']
    )


class OneMessage(Syntax):
    """A service of one message."""

    noun = "this service"
    message: Name = Field(description="The message that carries it.", examples=["hello"])


_OneMessage = Annotated[OneMessage, in_schema(NameText | OneMessage)]


class RequestAndReply(Syntax):
    """A service of a question and an answer."""

    noun = "this service"
    request: Name = Field(description="The message from the host.", examples=["ping"])
    reply: Name = Field(description="The answer from the MCU.", examples=["pong"])


class ParameterService(Syntax):
    """Reading and setting values on the MCU by index."""

    noun = "`parameter`"
    read: Name = Field(description="Asks for a value.", examples=["parameter_read"])
    set: Name = Field(description="Sets a value.", examples=["parameter_set"])
    value: Name = Field(description="The MCU's answer to both.", examples=["parameter_value"])


class Services(Syntax):
    """Built-in services, mapped to messages of this protocol."""

    noun = "`services`"
    hello: _OneMessage | None = Field(None, description="Both ends say which protocol they were built from.")
    ping: RequestAndReply | None = Field(None, description="Round trip time.")
    clock: RequestAndReply | None = Field(None, description="Clock offset and drift.")
    log: _OneMessage | None = Field(None, description="Lines of text from the MCU.")
    parameter: ParameterService | None = Field(None, description="Values on the MCU, read and set by index.")
    counters: _OneMessage | None = Field(None, description="The counters of the MCU's link, sent automatically.")


# ---- the file ------------------------------------------------------------------------------------


def _version(value: object) -> int:
    if not isinstance(value, Number) or value.value != 1:
        raise wrong(
            f"{describe(value)} is not a version of the file format known here; write `wirebond: 1`, or update Wirebond"
        )
    return 1


class File(Syntax):
    """A Wirebond protocol file: everything that both ends of a serial link must agree on."""

    noun = "a protocol file"

    wirebond: Annotated[int, PlainValidator(_version, json_schema_input_type=Literal[1])] = Field(
        description="Version of the file format.", examples=[1]
    )
    protocol: ProtocolName = Field(description="The protocol's name; a namespace in C++.", examples=["my_robot"])
    description: Text = Field("", description="For people.", examples=["what it links"])
    link: Link = Field(
        default_factory=lambda: Link.model_validate({}),
        description="The serial line: speed and shape of a byte.",
        examples=["{baud: 115200}"],
    )
    fixed: Annotated[str | None, one_word("host", "mcu", "both")] = Field(
        None,
        description="The end that exists already and cannot change, such as a bought device. `check` then gives "
        "advice to the owner of the other end.",
        examples=["mcu"],
    )
    frame: list[Part] = Field(
        min_length=1,
        max_length=MAX_PARTS,
        description="The parts of a frame, in wire order.",
        examples=["[magic: 0xAA, id: u8, payload: by_id, check: crc-16/mcrf4xx]"],
    )
    max_payload: PayloadBytes | None = Field(
        None,
        description="Most payload bytes of a frame. Default: the largest known message.",
        examples=[64],
    )
    idle: Duration | None = Field(
        None,
        description="Silence after which an incomplete frame is given up. Default: 20 ms or the time of two largest "
        "frames, whichever is longer.",
        examples=["20 ms"],
    )
    unknown: Annotated[str | None, one_word("deliver", "reject")] = Field(
        None,
        description="Frames of unknown id or other size: delivered as unknown, or taken for a false start. Default: "
        "`deliver` if a check of 16 bits or more covers id, length and payload, else `reject`.",
        examples=["deliver"],
    )
    resync: Annotated[str, one_word("rescan", "strict")] = Field(
        "rescan",
        description="What happens after a failed candidate: the search goes on at its second byte, or, if its size "
        "was known, after its end (`strict`).",
        examples=["strict"],
    )
    byte_order: Annotated[str, one_word("little", "big")] = Field(
        "little", description="Byte order of all numbers that name none.", examples=["little"]
    )
    types: dict[Name, Fields] = Field(
        default_factory=dict,
        description="Fields under a name, for structs and groups of several messages.",
        examples=["{point: {x: {type: f32}, y: {type: f32}}}"],
    )
    messages: dict[Name, MessageSyntax] = Field(
        min_length=1, description="The messages, by name.", examples=["{ping: {id: 0x01, sender: host}}"]
    )
    deadlines: list[DeadlineSyntax] = Field(
        default_factory=list,
        description="Actions for messages that stay away.",
        examples=["[{message: velocity, at: mcu, after: 1 s, then: stop}]"],
    )
    emergency_stop: EmergencyStopSyntax | None = Field(
        None,
        description="The message that stops everything, and its values; or a list of such messages.",
        examples=["{message: velocity, linear: 0, angular: 0}"],
    )
    services: Services | None = Field(
        None,
        description="Built-in services, mapped to messages of this protocol.",
        examples=["{ping: {request: ping, reply: pong}}"],
    )
    examples: list[ExampleSyntax] = Field(
        default_factory=list,
        description="Worked examples; `wirebond check` works them out again and compares.",
        examples=['[{message: ping, fields: {number: 1}, bytes: "AA 55 01"}]'],
    )
