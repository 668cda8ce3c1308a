"""Loads a protocol file into the model: the order of the steps, without their work."""

from __future__ import annotations

import os
from dataclasses import replace

from wirebond.protocol.meaning import references
from wirebond.protocol.meaning.delimiters import with_excluded
from wirebond.protocol.meaning.draft import (
    delivers_unknown,
    finish,
    longest_sent,
    skips_failed,
    validate_first_bytes,
    validate_sizes,
)
from wirebond.protocol.meaning.examples import read_examples
from wirebond.protocol.meaning.frames import read_frame
from wirebond.protocol.meaning.matching import read_matches
from wirebond.protocol.meaning.messages import read_messages, validate_ids
from wirebond.protocol.meaning.structs import Types
from wirebond.protocol.model import ByteOrder, End, LinkSettings, Mismatch, Parity, Protocol
from wirebond.protocol.problems import Problems
from wirebond.protocol.text import yaml_tree
from wirebond.protocol.text.grammar import File, Link
from wirebond.protocol.text.short_forms import written_out
from wirebond.protocol.text.syntax import readable, validate_syntax
from wirebond.protocol.text.yaml_tree import Mapping, Node, Scalar


def load(path: str | os.PathLike[str]) -> Protocol:
    """Read a protocol file.

    Raises ProtocolFileError, which lists everything that is wrong with the file, and nothing else.
    """
    return loads(yaml_tree.read_text(path), str(path))


def loads(text: str, path: str = "<text>") -> Protocol:
    """Load from text, as `load`; ``path`` is its name in errors."""
    problems = Problems(path)
    root = written_out(yaml_tree.parse(text, problems))
    validate_syntax(root, problems)
    protocol = _read(root, path, problems) if isinstance(root, Mapping) else None
    problems.raise_if_any()
    assert protocol is not None, "what is missing from the protocol has been reported"
    return replace(protocol, text=text)


def _read(root: Mapping, path: str, problems: Problems) -> Protocol | None:
    """Read every section that can be read, so that one wrong section does not hide faults of the others."""
    order = _byte_order(root)
    draft = read_frame(root.get("frame"), order, problems)
    types = Types(root.get("types"), order, problems)
    types.read_all()
    messages = read_messages(root.get("messages"), types, problems)
    if draft is not None:
        draft, messages = read_matches(draft, messages, problems)
    deadlines = references.read_deadlines(root.get("deadlines"), messages, draft, problems)
    emergency_stop = references.read_emergency_stop(root.get("emergency_stop"), messages, draft, problems)
    services = references.read_services(root.get("services"), messages, problems)
    examples = read_examples(root.get("examples"), messages, draft, problems)
    if draft is None:
        return None
    with_id = {end for end in (End.HOST, End.MCU) if draft.has_id_from(end)}
    without_id = {end for end in (End.HOST, End.MCU) if not draft.has_id_from(end, always=True)}
    validate_ids(messages, draft.id_bits, with_id, without_id, problems)
    file = readable(File, root)
    if file is None:
        # The file's own limits may be wrong; the frame's limits apply in any case.
        validate_sizes(draft, messages, None, problems, root.place)
        return None
    max_payload = validate_sizes(draft, messages, file.max_payload, problems, root.value_place("max_payload"))
    deliver_unknown = delivers_unknown(draft, file.unknown, problems, root.value_place("unknown"))
    validate_first_bytes(draft, messages, problems)
    is_strict = skips_failed(draft, file.resync, problems, root.value_place("resync"))
    longest = longest_sent(draft, messages) if file.max_payload is None else ()
    frame_format = finish(draft, max_payload, deliver_unknown, is_strict, longest)
    read = tuple(entry.message for entry in messages.values() if entry.message is not None)
    return Protocol(
        name=file.protocol,
        format=frame_format,
        messages=with_excluded(read, frame_format),
        link=_link(file.link),
        deadlines=deadlines,
        emergency_stop=emergency_stop,
        services=services,
        examples=examples,
        idle=draft.envelope.silence or file.idle,
        fixed=None if file.fixed is None else End(file.fixed),
        description=file.description,
        path=path,
    )


def _byte_order(root: Mapping) -> ByteOrder:
    node: Node | None = root.get("byte_order")
    is_big = isinstance(node, Scalar) and node.value == "big"
    return ByteOrder.BIG if is_big else ByteOrder.LITTLE


def _link(syntax: Link) -> LinkSettings:
    return LinkSettings(
        syntax.baud,
        syntax.data_bits,
        Parity(syntax.parity),
        syntax.stop_bits,
        syntax.max_run,
        syntax.max_age,
        syntax.echo,
        syntax.adapter_latency,
        Mismatch(syntax.on_mismatch),
    )
