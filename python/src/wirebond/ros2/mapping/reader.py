"""From a mapping file to a mapping: every name is looked up, every type compared, every mistake has its place."""

from __future__ import annotations

import os
from collections.abc import Iterable

from wirebond.link.requests import DEFAULT_TIMEOUT
from wirebond.protocol.model import End, Message, Protocol, Recover
from wirebond.protocol.problems import WHOLE_FILE, Place, Problems, nearest, suggestion
from wirebond.protocol.text import yaml_tree
from wirebond.protocol.text.syntax import readable, validate_syntax
from wirebond.protocol.text.yaml_tree import Mapping, Node, Sequence
from wirebond.ros2.mapping.filler import Tree, source_reader
from wirebond.ros2.mapping.grammar import (
    File,
    FlagsSyntax,
    OdometrySyntax,
    PublishSyntax,
    QosSyntax,
    ServiceSyntax,
    Source,
    SubscribeSyntax,
)
from wirebond.ros2.mapping.model import (
    BridgeMapping,
    FlagsMapping,
    Incoming,
    NavigationMapping,
    OdometryMapping,
    Outgoing,
    ServiceMapping,
    Wheels,
)
from wirebond.ros2.mapping.own_types import OwnTypes, own_commands, own_topics
from wirebond.ros2.mapping.paths import Getter, PathError, What, ros_place, wire_leaf
from wirebond.ros2.mapping.sources import Sources
from wirebond.ros2.mapping.unpacking import unpack_plan
from wirebond.ros2.node import Qos
from wirebond.ros2.types import RosType, ServiceType, ros_type, service_type, type_names

_LONGEST = 60.0  # seconds that a service may keep its caller waiting


def default_mapping(protocol: Protocol) -> BridgeMapping:
    """Return the mapping without a file: every message has a topic with JSON."""
    return BridgeMapping(
        node=protocol.name.replace("-", "_"), json_out=_sent_by(protocol, End.MCU), json_in=_sent_by(protocol, End.HOST)
    )


def load_mapping(path: str | os.PathLike[str], protocol: Protocol) -> BridgeMapping:
    """Read a mapping file for this protocol.

    :raises ProtocolFileError: with everything that is wrong with it.
    """
    return read_mapping(yaml_tree.read_text(path), protocol, str(path))


def read_mapping(text: str, protocol: Protocol, path: str = "<text>") -> BridgeMapping:
    """Read a mapping from text, as `load_mapping`; ``path`` is its name in errors."""
    problems = Problems(path)
    root = yaml_tree.parse(text, problems)
    validate_syntax(root, problems, File)
    file = readable(File, root)
    if file is None or not isinstance(root, Mapping):
        problems.raise_if_any()
        raise AssertionError("what is wrong with the file was reported")
    mapping = _Reader(protocol, problems).read(file, root, path)
    problems.raise_if_any()
    return mapping


def _sent_by(protocol: Protocol, end: End) -> tuple[Message, ...]:
    return tuple(m for m in protocol.messages if m.sent_by(end))


class _Reader:
    """A file. What is wrong is added to ``problems``, and left out of the result."""

    def __init__(self, protocol: Protocol, problems: Problems) -> None:
        self.protocol = protocol
        self.problems = problems
        self.own = OwnTypes(protocol)
        self.sources = Sources(problems)

    def read(self, file: File, root: Mapping, path: str) -> BridgeMapping:
        publish = [self._publish(s, n) for s, n in zip(file.publish, _items(root, "publish"), strict=True)]
        subscribe = [self._subscribe(s, n) for s, n in zip(file.subscribe, _items(root, "subscribe"), strict=True)]
        services = [self._service(s, n) for s, n in zip(file.services, _items(root, "services"), strict=True)]
        odometry = self._odometry(file.odometry, root.get("odometry"))
        for name, node in zip(file.poll, _items(root, "poll"), strict=True):
            self._polled(name, node.place)
        flags = [self._flags(s, n) for s, n in zip(file.diagnostics, _items(root, "diagnostics"), strict=True)]
        navigation = None
        if file.navigation is not None:
            navigation = NavigationMapping(
                file.navigation.deadline, file.navigation.topic, tuple(file.navigation.cancel)
            )
            self._deadline(navigation.deadline, _place_in(root.get("navigation"), "deadline"))
        if file.emergency_stop is not None and not self.protocol.emergency_stop:
            self.problems.add(
                root.value_place("emergency_stop"),
                f"{self.protocol.name} has no emergency_stop; add one to the protocol file, or remove this key",
            )
        messages = {m.name for m in self.protocol.messages}
        mapped = {s.message for s in file.publish} | {s.message for s in file.subscribe}
        mapped |= {odometry.message} if odometry else set()
        chosen = {"all": messages, "unmapped": messages - mapped, "none": set[str]()}
        typed = chosen[file.typed_topics]
        as_json = chosen[file.json_topics] - typed
        return BridgeMapping(
            node=file.node or default_mapping(self.protocol).node,
            namespace=file.namespace,
            json_out=tuple(m for m in _sent_by(self.protocol, End.MCU) if m.name in as_json),
            json_in=tuple(m for m in _sent_by(self.protocol, End.HOST) if m.name in as_json),
            serial=file.serial,
            publish=(
                *(p for p in publish if p is not None),
                *own_topics(self.protocol, self.own, End.MCU, "~/{}", typed),
            ),
            subscribe=(*(s for s in subscribe if s is not None), *own_commands(self.protocol, self.own, typed)),
            services=tuple(s for s in services if s is not None),
            odometry=odometry,
            poll=tuple(file.poll),
            diagnostics=tuple(f for f in flags if f is not None),
            navigation=navigation,
            emergency_stop=file.emergency_stop,
            recover=file.recover,
            latency=file.latency,
            path=path,
        )

    # ---- the sections

    def _publish(self, syntax: PublishSyntax, node: Node) -> Outgoing | None:
        message = self._message(syntax.message, End.MCU, _place_in(node, "message"))
        type_ = self._type(syntax.type, _place_in(node, "type"))
        if message is None or type_ is None:
            return None
        is_own = syntax.fields is None and self._is_own(type_, message, syntax, node)
        tree, before = self.own.tree(message.name) if is_own else Tree(type_), len(self.problems)
        self._fill(tree, message, syntax.fields or {}, _in(node, "fields"))
        has_all = len(self.problems) == before
        headers = tree.stamp(syntax.frame, syntax.child_frame)
        if syntax.frame and not headers:
            self.problems.add(_place_in(node, "frame"), f"{type_.short} has no header for a frame; remove this key")
        return Outgoing(
            message.name,
            syntax.topic,
            type_,
            _qos(syntax.qos),
            syntax.at_most or 0.0,
            tree.filler(),
            tree.plan(message.name) if has_all else None,
            reads_header=is_own,
        )

    def _subscribe(self, syntax: SubscribeSyntax, node: Node) -> Incoming | None:
        message = self._message(syntax.message, End.HOST, _place_in(node, "message"))
        type_ = self._type(syntax.type, _place_in(node, "type"))
        if message is None or type_ is None:
            return None
        if syntax.stale is not None and message.every is None:
            self.problems.add(
                _place_in(node, "stale"), f"{message.name} has no `every` to repeat it at; add one to the protocol file"
            )
        if syntax.stale is not None and syntax.stale > 60:
            self.problems.add(
                _place_in(node, "stale"), "a command is repeated for 60 s at most; write less, such as 500 ms"
            )
        if syntax.fields is None:
            if not self._is_own(type_, message, syntax, node):
                return None
            getters, plan = self.own.getters(message.name), self.own.plan(message.name)
            return Incoming(syntax.topic, type_, message.name, _qos(syntax.qos), getters, syntax.stale, plan)
        before, plan = len(self.problems), None
        values = self._values(message, type_, syntax.fields, node)
        if len(self.problems) == before:
            places = {n: (ros_place(type_, s.path).steps if s.path else (), s) for n, s in syntax.fields.items()}
            plan = unpack_plan(message.name, type_, places)
        return Incoming(syntax.topic, type_, message.name, _qos(syntax.qos), values, syntax.stale, plan)

    def _service(self, syntax: ServiceSyntax, node: Node) -> ServiceMapping | None:
        type_ = service_type(syntax.type)
        assert type_ is not None, "the grammar has looked"
        if (syntax.message is None) == (syntax.recover is None):
            self.problems.add(node.place, "a service needs either `message` or `recover`; write one of them")
            return None
        if syntax.recover is not None:
            return self._recovering(syntax, syntax.recover, type_, node)
        assert syntax.message is not None, "one of the two is there"
        message = self._message(syntax.message, End.HOST, _place_in(node, "message"))
        if message is None:
            return None
        values = self._values(message, type_.request, syntax.fields, node)
        reply = None if message.reply is None else self.protocol.message(message.reply)
        for key, given in (("answer", syntax.answer), ("timeout", syntax.timeout)):
            if given and reply is None:
                self.problems.add(
                    _place_in(node, key), f"{message.name} has no `reply` in the protocol file; remove this key"
                )
        answer = None
        if syntax.answer and type_.response.field("success") is None:
            self.problems.add(
                _place_in(node, "answer"), f"{type_.name} answers nothing; take std_srvs/Trigger, or remove this key"
            )
        elif syntax.answer and reply is not None:
            tree = Tree(type_.response)
            self._fill(tree, reply, syntax.answer, _in(node, "answer"))
            answer = tree.filler()
        timeout = DEFAULT_TIMEOUT if syntax.timeout is None else syntax.timeout
        if timeout > _LONGEST:
            self.problems.add(
                _place_in(node, "timeout"), f"a call waits for {_LONGEST:.0f} s at most; write less, such as 500 ms"
            )
        return ServiceMapping(syntax.service, type_, message.name, values, reply is not None, timeout, answer)

    def _recovering(self, syntax: ServiceSyntax, action: str, type_: ServiceType, node: Node) -> ServiceMapping:
        for key in ("fields", "answer", "timeout"):
            if _in(node, key) is not None:
                self.problems.add(_place_in(node, key), "`recover` sends no message; remove this key")
        self._deadline(action, _place_in(node, "recover"))
        found = [d for d in self.protocol.deadlines if d.at == End.HOST and d.then == action]
        if found and found[0].recover != Recover.EXPLICIT:
            self.problems.add(
                _place_in(node, "recover"),
                f"{action} ends by itself; `recover` is for deadlines with `recover: explicit`",
            )
        if type_.request.field("data") is not None:
            self.problems.add(_place_in(node, "type"), "`recover` needs no true or false; write std_srvs/Trigger")
        return ServiceMapping(syntax.service, type_, "", recover=action)

    def _odometry(self, syntax: OdometrySyntax | None, node: Node | None) -> OdometryMapping | None:
        if syntax is None:
            return None
        message = self._message(syntax.message, End.MCU, _place_in(node, "message"))
        for key, name in (("left", syntax.left), ("right", syntax.right)) if message is not None else ():
            try:
                assert message is not None, "looked at before"
                leaf, _ = wire_leaf(message, name)
                if leaf.what not in (What.INTEGER, What.NUMBER) or leaf.is_list:
                    raise PathError(f"{name} is {leaf.described}; expected the ticks of a wheel, a number")
            except PathError as error:
                self.problems.add(_place_in(node, key), str(error))
        for key, given, amount in (
            ("joints", syntax.joints, (0, 2)),
            ("pose_deviation", syntax.pose_deviation, (3,)),
            ("twist_deviation", syntax.twist_deviation, (2,)),
        ):
            if len(given) not in amount:
                self.problems.add(_place_in(node, key), f"`{key}` has {len(given)} values; expected {amount[-1]}")
        return OdometryMapping(
            syntax.message,
            syntax.left,
            syntax.right,
            Wheels(syntax.wheel_radius, syntax.wheel_separation, syntax.ticks_per_turn),
            syntax.frame,
            syntax.child_frame,
            syntax.topic,
            syntax.tf,
            syntax.reset,
            tuple(syntax.joints),
            tuple(syntax.pose_deviation),
            tuple(syntax.twist_deviation),
        )

    def _polled(self, name: str, place: Place) -> None:
        message = self._message(name, End.HOST, place)
        if message is not None and (message.every is None or message.reply is None):
            self.problems.add(
                place, f"{name} is not a request with an `every`; give it `every` and `reply` in the protocol file"
            )

    def _flags(self, syntax: FlagsSyntax, node: Node) -> FlagsMapping | None:
        message = self._message(syntax.message, End.MCU, _place_in(node, "message"))
        if message is None:
            return None
        try:
            leaf, _ = wire_leaf(message, syntax.field)
            if leaf.what != What.FLAGS:
                raise PathError(f"{syntax.field} is {leaf.described}; expected a field with `flags`")
        except PathError as error:
            self.problems.add(_place_in(node, "field"), str(error))
            return None
        words = node.get("words") if isinstance(node, Mapping) else None
        for name in syntax.words:
            if name not in leaf.choices:
                advice = suggestion(name, leaf.choices)
                self.problems.add(_places(words, name)[0], f"{syntax.field} has no flag `{name}`; {advice}")
        return FlagsMapping(
            message.name, syntax.field, {name: syntax.words.get(name, name.replace("_", " ")) for name in leaf.choices}
        )

    def _deadline(self, name: str, place: Place) -> None:
        actions = [d.then for d in self.protocol.deadlines if d.at == End.HOST]
        if name not in actions:
            self.problems.add(place, f"the host has no deadline `{name}`; {suggestion(name, actions)}")

    def _is_own(self, type_: RosType, message: Message, syntax: PublishSyntax | SubscribeSyntax, node: Node) -> bool:
        """Check whether it is the type generated for this message. Without `fields` it must be."""
        own = self.own.of(message.name)
        if type_ is not own:
            self.problems.add(
                _place_in(node, "type"),
                f"{syntax.noun} needs `fields`, which say where each value of {type_.short} comes from; only "
                f"{own.short}, the type of {message.name} itself, needs none",
            )
        return type_ is own

    def _fill(self, tree: Tree, message: Message, fields: dict[str, Source], node: Node | None) -> None:
        """Put the values of this message into a type of ROS. ``fields``: sources by its fields."""
        for path, source in fields.items():
            key, value = _places(node, path)
            try:
                place = ros_place(tree.type, path)
            except PathError as error:
                self.problems.add(key, str(error))
                continue
            if place.leaf.what == What.GROUP:
                self.problems.add(
                    key, f"{path} is {place.field.spelled}; map its fields: {', '.join(place.leaf.choices)}"
                )
                continue
            getter = self.sources.of_message(source, message, place.leaf, place.owner.constants, value)
            as_text = place.leaf.what == What.TEXT
            tree.put(place.steps, source_reader(source, getter, place.owner.constants, as_text))

    def _values(
        self, message: Message, type_: RosType, fields: dict[str, Source], node: Node
    ) -> tuple[tuple[str, Getter], ...]:
        """Return how to read each field of this message from a type of ROS."""
        values: list[tuple[str, Getter]] = []
        for name, source in fields.items():
            key, value = _places(_in(node, "fields"), name)
            try:
                target, _ = wire_leaf(message, name)
                if "." in name:
                    raise PathError(f"{name} is within a field; map whole fields of {message.name}")
            except PathError as error:
                self.problems.add(key, str(error))
                continue
            getter = self.sources.of_topic(source, type_, target, value)
            if getter is not None:
                values.append((name, getter))
        missing = [
            f.name
            for f in message.fields
            if f.name not in fields
            and f.default is None
            and f.has_value
            and not f.is_count
            and f.value_type is not dict
        ]
        if missing:
            place = _place_in(node, "fields")
            self.problems.add(place, f"{message.name} needs {', '.join(missing)}, without a default; map it here")
        return tuple(values)

    # ---- names

    def _message(self, name: str, sender: End, place: Place) -> Message | None:
        found = next((m for m in self.protocol.messages if m.name == name), None)
        if found is not None and found.sent_by(sender):
            return found
        names = [m.name for m in _sent_by(self.protocol, sender)]
        if found is not None:
            self.problems.add(place, f"{name} is not sent by the {sender}; {suggestion(name, names)}")
        else:
            self.problems.add(place, f"{self.protocol.name} has no message `{name}`; {suggestion(name, names)}")
        return None

    def _type(self, name: str, place: Place) -> RosType | None:
        found = self.own.named(name) or ros_type(name)
        if found is None:
            near = nearest(name.replace("/msg/", "/"), [*self.own.names, *type_names()])
            hint = f"did you mean {near}?" if near else "write package and name, such as geometry_msgs/Twist"
            self.problems.add(place, f"there is no message type `{name}` in ROS 2; {hint}")
        return found


def _qos(syntax: QosSyntax | None) -> Qos:
    if syntax is None:
        return Qos()
    return Qos(syntax.reliability == "reliable", syntax.durability == "transient_local", syntax.depth)


def _items(root: Mapping, key: str) -> Iterable[Node]:
    node = root.get(key)
    return node.items if isinstance(node, Sequence) else ()


def _in(node: Node | None, key: str) -> Node | None:
    return node.get(key) if isinstance(node, Mapping) else None


def _place_in(node: Node | None, key: str) -> Place:
    if isinstance(node, Mapping):
        return node.value_place(key)
    return WHOLE_FILE if node is None else node.place


def _places(node: Node | None, key: str) -> tuple[Place, Place]:
    """Return the places of a key and of its value."""
    if isinstance(node, Mapping):
        return node.key_place(key), node.value_place(key)
    return WHOLE_FILE, WHOLE_FILE
