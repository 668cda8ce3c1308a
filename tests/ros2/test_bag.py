"""A recording as a bag: other programs read what was recorded, with its times."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.interfaces import QosDurability
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import wirebond
from tests.recording.made import WALL_NS, drive, made
from tests.shared import PROTOCOLS
from wirebond.cli.main import main
from wirebond.ros2.bag import write_bag
from wirebond.ros2.mapping import default_mapping

ROVER = PROTOCOLS / "diffdrive.yaml"
MAPPING = PROTOCOLS / "ros2" / "diffdrive.yaml"


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    codec = wirebond.load(ROVER)
    return made(tmp_path_factory.mktemp("recorded") / "run.mcap", codec, drive(codec, 2.0))


@pytest.fixture(scope="module")
def bag(recording: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("exported")
    command = ["export", str(recording), "--to", "ros2", "--mapping", str(MAPPING), "-o", str(out)]
    assert main(command) == 0
    assert sorted(path.name for path in (out / "run-ros2").iterdir()) == ["metadata.yaml", "run-ros2.mcap"]
    return out / "run-ros2"


def by_rosbags(bag: Path) -> dict[str, list[tuple[int, Any]]]:
    """Time and message by topic, as rosbags reads them with the types that are in the bag."""
    found: dict[str, list[tuple[int, Any]]] = {}
    with Reader(bag) as reader:
        store = get_typestore(Stores.ROS2_JAZZY)
        for connection in reader.connections:
            types = get_types_from_msg(connection.msgdef.data, connection.msgtype)
            store.register({name: type_ for name, type_ in types.items() if name not in store.fielddefs})
            assert connection.digest == store.hash_rihs01(connection.msgtype)
        for connection, t_ns, data in reader.messages():
            message = store.deserialize_cdr(data, connection.msgtype)
            assert bytes(store.serialize_cdr(message, connection.msgtype)) == bytes(data)
            found.setdefault(connection.topic, []).append((t_ns, message))
    return found


def test_every_message_is_in_it_with_its_values_and_times(recording: Path, bag: Path) -> None:
    found = by_rosbags(bag)
    recorded = list(wirebond.recording.open(recording))
    for name, fields in (("odometry", ("left_ticks", "right_ticks")), ("status", ("battery",))):
        ours = [message for message in recorded if message.name == name]
        theirs = found[f"/diffdrive/{name}"]
        assert len(theirs) == len(ours) > 1
        for message, (t_ns, their) in zip(ours, theirs, strict=True):
            at_ns = WALL_NS + round(message.t * 1e6) * 1000
            assert (t_ns, their.header.stamp.sec, their.header.stamp.nanosec) == (at_ns, *divmod(at_ns, 10**9))
            assert [getattr(their, field) for field in fields] == [message.fields[field] for field in fields]
    assert {status.errors for _, status in found["/diffdrive/status"]} == {16}
    velocities = [message.fields for message in recorded if message.name == "velocity"]
    sent = [{"linear": one.linear, "angular": one.angular} for _, one in found["/diffdrive/velocity/sent"]]
    assert sent == velocities


def test_topics_of_the_mapping_are_as_the_bridge_publishes_them(bag: Path) -> None:
    found = by_rosbags(bag)
    assert {"/odom", "/tf", "/joint_states", "/battery_state", "/estop"} < set(found)
    assert not any("send" in topic for topic in found)  # a bag that is played commands nothing
    assert [message.voltage for _, message in found["/battery_state"]] == [12.0, 12.0]
    (_, first), *_, (_, last) = found["/odom"]
    assert (first.header.frame_id, first.child_frame_id) == ("odom", "base_link")
    assert last.pose.pose.position.x != first.pose.pose.position.x or last.pose.pose.orientation.z != 0
    with Reader(bag) as reader:
        latched = {
            connection.topic
            for connection in reader.connections
            if connection.ext.offered_qos_profiles[0].durability == QosDurability.TRANSIENT_LOCAL  # type: ignore[union-attr]
        }
    assert latched == {"/estop"}


def test_other_readers_of_mcap_decode_it(bag: Path) -> None:
    with (bag / "run-ros2.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        decoded = [(channel.topic, message) for _, channel, _, message in reader.iter_decoded_messages()]
        summary = reader.get_summary()
    assert summary is not None
    assert {(schema.encoding) for schema in summary.schemas.values()} == {"ros2msg"}
    assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
    ours = by_rosbags(bag)
    assert len(decoded) == sum(map(len, ours.values()))
    status = [message for topic, message in decoded if topic == "/diffdrive/status"]
    assert [(one.battery, one.errors) for one in status] == [(12.0, 16)] * 2


def test_without_a_mapping_every_message_has_its_own_type(recording: Path, tmp_path: Path) -> None:
    opened = wirebond.recording.open(recording)
    seen: list[tuple[int, int]] = []
    assert (
        write_bag(opened, tmp_path / "bag", default_mapping(opened.codec.model), progress=lambda *p: seen.append(p))
        == []
    )
    topics = {"odometry", "status", "velocity/sent", "status_query/sent"}
    assert set(by_rosbags(tmp_path / "bag")) == {f"/diffdrive/{topic}" for topic in topics}
    assert seen[0][1] == 2000


def test_one_message_alone(recording: Path, tmp_path: Path) -> None:
    command = ["export", str(recording), "--to", "ros2", "--message", "status", "-o", str(tmp_path)]
    assert main(command) == 0
    assert set(by_rosbags(tmp_path / "run-ros2")) == {"/diffdrive/status"}


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--message", "parameter"], "the recording has no such message"),
        (["--message", "speed"], "diffdrive has no message"),
        (["--mapping", str(ROVER)], "wirebond_ros2"),
        (["--to", "csv", "--mapping", str(MAPPING)], "--mapping is for `--to ros2`"),
        (["--to", "rosbag"], "expected csv, parquet, mcap, or ros2"),
    ],
)
def test_a_failed_bag_leaves_no_file(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], sentence: str
) -> None:
    assert main(["export", str(recording), "--to", "ros2", "-o", str(tmp_path), *options]) != 0
    assert sentence in " ".join(capsys.readouterr().err.split())
    assert not list(tmp_path.iterdir())


def test_a_bag_that_exists_is_replaced_only_on_request(recording: Path, tmp_path: Path) -> None:
    command = ["export", str(recording), "--to", "ros2", "-o", str(tmp_path)]
    assert main([*command, "--message", "status"]) == 0
    assert main(command) == 2
    assert set(by_rosbags(tmp_path / "run-ros2")) == {"/diffdrive/status"}
    assert main([*command, "--force"]) == 0
    assert {"/diffdrive/status", "/diffdrive/odometry"} <= set(by_rosbags(tmp_path / "run-ros2"))
    assert [path.name for path in tmp_path.iterdir()] == ["run-ros2"]


def test_a_folder_that_exists_is_left_as_it_is(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "run-ros2").mkdir()
    (tmp_path / "run-ros2" / "mine").write_text("mine")
    assert main(["export", str(recording), "--to", "ros2", "-o", str(tmp_path)]) == 2
    assert "run-ros2 exists already; nothing was written" in " ".join(capsys.readouterr().err.split())
    assert main(["export", str(recording), "--to", "ros2", "-o", str(tmp_path), "--force"]) == 2
    assert "run-ros2 is not a bag, and is left as it is" in " ".join(capsys.readouterr().err.split())
    assert [path.name for path in tmp_path.rglob("*")] == ["run-ros2", "mine"]


def test_a_value_that_its_topic_cannot_hold_is_reported_once(recording: Path, tmp_path: Path) -> None:
    opened = wirebond.recording.open(recording)
    mapping = wirebond_mapping(opened, "{data: {from: right_ticks, scale: 1000000, offset: 0}}", "std_msgs/Float32")
    assert write_bag(opened, tmp_path / "fits", mapping) == []
    huge = wirebond_mapping(opened, "{data: {from: right_ticks, scale: 1e300, offset: 0}}", "std_msgs/Float32")
    (sentence,) = write_bag(opened, tmp_path / "bag", huge)
    assert sentence.startswith("x lacks 39 messages: ")


def wirebond_mapping(opened: Any, fields: str, type_name: str) -> Any:
    from wirebond.ros2.mapping import read_mapping  # noqa: PLC0415

    text = f"wirebond_ros2: 1\npublish: [{{message: odometry, topic: x, type: {type_name}, fields: {fields}}}]\n"
    return read_mapping(text, opened.codec.model)
