"""The behaviour of a host's link: stop, leases, deadlines, account, reconnecting. Each test runs on the core under
virtual time, and over a pty on the engine's thread and on threads in Python."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

import wirebond
from tests.link.drivers import Driver, PythonDriver, ThreadDriver, VirtualDriver
from tests.link.protocol import manipulator
from tests.waiting import moments
from wirebond.errors import LinkDownError, StoppedError

pytestmark = pytest.mark.live

Make = Callable[..., Driver]
FULL_SPEED = {"speed": 1000, "turn": 7}
STOP = [("arm", {"torque": 0}), ("drive", {"speed": 0, "turn": 0})]


@pytest.fixture(params=[VirtualDriver, ThreadDriver, PythonDriver], ids=lambda kind: kind.kind)
def make(request: pytest.FixtureRequest) -> Iterator[Make]:
    made: list[Driver] = []

    def build(codec: wirebond.Codec | None = None, **options: Any) -> Driver:
        made.append(request.param(codec or manipulator(), **options))
        return made[-1]

    yield build
    for driver in made:
        driver.check()
        driver.end()


# ---- the emergency stop -----------------------------------------------------------------------------------------


def test_a_stop_passes_a_full_queue_and_nothing_older_of_its_messages_follows(make: Make) -> None:
    link = make()
    taken = link.fill_queue("drive", **FULL_SPEED)
    assert taken > 1000
    link.emergency_stop()
    stats = link.stats()["send"]
    assert stats["overruled"] >= taken - stats["sent"] - 1  # and one under way
    assert stats["queued"] < 10
    link.run_until(lambda: STOP[1] in link.messages(), "the stop arrives")
    link.run(0.2)
    found = link.messages()
    first = found.index(STOP[0])
    assert all(message in STOP for message in found[first:])
    assert found[first : first + 2] == STOP  # in the file's order
    if isinstance(link, VirtualDriver):  # a process that is paused sends more before the stop
        assert stats["overruled"] > 1000
        assert first < taken / 2  # how few exactly: test_paced_wire.py


def test_frames_of_other_messages_are_neither_dropped_nor_before_the_stop(make: Make) -> None:
    link = make()
    for _ in moments("a stop before what waits"):  # a process that is paused may have sent it all by then
        before = len(link.messages())
        for number in range(200):
            link.send("note", number=number)
            link.send("drive", **FULL_SPEED)
        link.emergency_stop()
        link.run_until(lambda before=before: link.names()[before:].count("note") == 200, "every note arrives")
        found = link.messages()[before:]
        notes = [fields["number"] for name, fields in found if name == "note"]
        assert notes == list(range(200))
        if found.index(STOP[0]) < 200:
            break
        assert not isinstance(link, VirtualDriver)
        link.release_stop()


def test_stopped_messages_are_refused_until_the_release_which_sends_nothing(make: Make) -> None:
    link = make()
    link.repeat("drive", hold=60, **FULL_SPEED)
    link.emergency_stop()
    with pytest.raises(StoppedError):
        link.send("drive", **FULL_SPEED)
    with pytest.raises(StoppedError):
        link.send("arm", torque=0)
    with pytest.raises(StoppedError):
        link.repeat("drive", **FULL_SPEED)
    link.send("lamp", level=3)  # not of the stop
    assert link.stats()["send"]["refused_stopped"] == 2
    link.run_until(lambda: link.names().count("drive") >= 3, "the stop is repeated")
    link.release_stop()
    link.settle()
    before = link.messages()
    link.run(0.3)
    assert link.messages() == before  # neither the stop nor the old lease goes on
    link.send("drive", speed=5, turn=0)
    link.run_until(lambda: link.messages()[-1] == ("drive", {"speed": 5, "turn": 0}), "it drives again")
    assert FULL_SPEED not in [fields for _, fields in link.messages()[1:]]


def test_a_stop_is_repeated_at_each_messages_rhythm(make: Make) -> None:
    link = make()
    link.emergency_stop()
    link.run_until(lambda: link.names().count("drive") >= 11, "11 stops of drive")
    # drive has 20 ms, arm has none: 50 ms. A thread that is late every time sends both each time.
    least, most = (3, 6) if isinstance(link, VirtualDriver) else (2, 12)
    assert least <= link.names().count("arm") <= most


def test_a_second_stop_is_sent_at_once_and_changes_nothing_else(make: Make) -> None:
    link = make()
    for _ in moments("a second stop at once"):  # until the second stop came before the first one was repeated
        before = len(link.messages())
        link.emergency_stop()
        link.run_until(lambda before=before: link.names()[before:][:2] == ["arm", "drive"], "the stop arrives")
        link.emergency_stop()
        link.run_until(lambda before=before: link.names()[before:].count("arm") >= 2, "arm is stopped again")
        with pytest.raises(StoppedError):
            link.send("drive", **FULL_SPEED)
        link.release_stop()
        # Repeats alone: drive at 20 ms and at 40 ms, arm at 50 ms.
        if link.names()[before:][:4] == ["arm", "drive", "arm", "drive"]:
            break
        link.settle()
    assert all(message in STOP for message in link.messages())
    link.send("drive", **FULL_SPEED)  # one release is enough
    link.run_until(lambda: link.messages()[-1] == ("drive", FULL_SPEED), "it drives again")


def test_a_stop_while_the_port_is_away_is_the_first_to_leave_when_it_is_back(make: Make) -> None:
    link = make()
    link.unplug()
    link.emergency_stop()
    with pytest.raises(StoppedError):
        link.send("drive", **FULL_SPEED)
    with pytest.raises(LinkDownError):
        link.send("lamp", level=1)
    link.run(0.1)
    link.plug()
    link.send("lamp", level=2)
    link.run_until(lambda: len(link.messages()) >= 3, "the port works again")
    assert link.messages()[:2] == STOP


@pytest.mark.parametrize("is_done", [True, False])
def test_a_stop_that_was_under_way_or_done_when_the_port_went_is_sent_again(make: Make, is_done: bool) -> None:
    link = make()
    link.emergency_stop()
    if is_done:
        link.run_until(lambda: "drive" in link.names(), "the stop arrives")
    link.unplug()
    link.run(0.1)
    link.plug()
    link.run_until(lambda: len(link.messages()) >= 2, "the port works again")
    assert link.messages()[:2] == STOP


# ---- leases -----------------------------------------------------------------------------------------------------


def test_a_lease_ends_with_the_safe_value_before_a_full_queue(make: Make) -> None:
    link = make()
    link.repeat("drive", hold=60, **FULL_SPEED)
    link.fill_queue("note", number=1, text=b"x" * 100)
    link.fill_queue("drive", **FULL_SPEED)  # into what is left
    link.repeat("drive", hold=0.1, **FULL_SPEED)
    link.run_until(lambda: ("drive", STOP[1][1]) in link.messages(), "the safe value arrives")
    link.run(0.1)
    found = [message for message in link.messages() if message[0] == "drive"]
    assert found.count(STOP[1]) == 1  # once, without a latch
    assert found[-1] == STOP[1]
    if isinstance(link, VirtualDriver):  # others may pause meanwhile
        assert link.messages().index(STOP[1]) < 100  # of the 600 that waited
    assert "arm" not in link.names()
    assert link.stats()["send"]["overruled"] >= 1


def test_a_lease_that_ended_holds_nothing(make: Make) -> None:
    link = make()
    link.repeat("drive", hold=0.03, **FULL_SPEED)
    link.run_until(lambda: STOP[1] in link.messages(), "the safe value arrives")
    link.send("drive", speed=5, turn=0)
    link.run_until(lambda: link.messages()[-1][1].get("speed") == 5, "it drives again")


def test_a_value_without_a_safe_value_falls_silent(make: Make) -> None:
    link = make()
    link.repeat("lamp", hold=0.05, level=9)
    link.run_until(lambda: "lamp" in link.names(), "the lamp")
    link.run(0.2)
    link.settle()
    before = link.messages()
    link.run(0.2)
    assert link.messages() == before
    assert len(before) >= (3 if isinstance(link, VirtualDriver) else 1)  # others may pause for longer than the lease
    assert set(link.names()) == {"lamp"}


def test_a_repeated_value_has_one_place_in_the_queue_and_leaves_with_the_newest_bytes(make: Make) -> None:
    link = make()
    for number in range(40):
        link.send("note", number=number, text=b"x" * 100)  # 0.4 s of line
    link.repeat("lamp", hold=60, level=1)
    link.run_until(lambda: link.stats()["send"]["replaced"] >= 5, "the lamp waits")
    link.repeat("lamp", hold=60, level=2)
    link.run_until(lambda: "lamp" in link.names(), "the lamp arrives")
    lamps = [fields["level"] for name, fields in link.messages() if name == "lamp"]
    assert lamps[0] == 2


def test_stop_repeating_drops_what_waits_and_sends_no_last_value(make: Make) -> None:
    link = make()
    for number in range(20):
        link.send("note", number=number, text=b"x" * 100)
    link.repeat("drive", hold=60, **FULL_SPEED)
    link.stop_repeating("drive")
    link.run_until(lambda: link.names().count("note") == 20, "the notes arrive")
    link.run(0.1)
    assert "drive" not in link.names()
    assert link.stats()["send"]["overruled"] == 1


def test_closing_sends_the_safe_value_before_a_full_queue(make: Make) -> None:
    for _ in moments("a link that closes without a pause of the machine"):
        link = make()
        link.fill_queue("note", number=1, text=b"x" * 100)
        link.repeat("drive", hold=60, **FULL_SPEED)
        link.close()
        found = link.messages()
        assert ("drive", FULL_SPEED) not in found
        stats = link.stats()["send"]
        assert stats["queued"] == 0
        if isinstance(link, VirtualDriver):  # a process that is paused sends more before it closes
            assert found.index(STOP[1]) < 100  # of the 600 that waited
            assert stats["expired"] > 0  # a second does not empty the queue
        if STOP[1] in found:
            break


def test_closing_sends_the_safe_value_of_everything_that_was_sent(make: Make) -> None:
    link = make()
    link.send("drive", **FULL_SPEED)
    link.send("lamp", level=1)
    link.run_until(lambda: "lamp" in link.names(), "both arrive")
    link.close()
    assert link.messages() == [("drive", FULL_SPEED), ("lamp", {"level": 1}), STOP[1]]  # and none for the arm


def test_closing_sends_no_second_safe_value(make: Make) -> None:
    link = make()
    link.send("drive", **FULL_SPEED)
    link.emergency_stop()
    link.release_stop()
    link.repeat("drive", hold=60, speed=5, turn=0)
    link.run_until(lambda: ("drive", {"speed": 5, "turn": 0}) in link.messages(), "it drives")
    link.repeat("drive", hold=0.02, speed=5, turn=0)
    link.run_until(lambda: link.messages()[-1] == STOP[1], "the lease ends")
    before = link.messages()
    link.close()
    assert link.messages() == before


def test_a_value_that_a_program_stopped_repeating_is_made_safe_at_the_end(make: Make) -> None:
    link = make()
    link.repeat("drive", hold=60, **FULL_SPEED)
    link.run_until(lambda: "drive" in link.names(), "it arrives")
    link.stop_repeating("drive")
    link.close()
    assert link.messages()[-1] == STOP[1]


def test_a_program_that_hands_over_leaves_the_robot_moving(make: Make) -> None:
    link = make()
    link.send("drive", **FULL_SPEED)
    link.run_until(lambda: "drive" in link.names(), "it arrives")
    link.hand_over()
    link.close()
    assert link.messages() == [("drive", FULL_SPEED)]


def test_commands_after_the_hand_over_are_made_safe_again(make: Make) -> None:
    link = make()
    link.hand_over()
    link.send("drive", **FULL_SPEED)
    link.run_until(lambda: "drive" in link.names(), "it arrives")
    link.close()
    assert link.messages() == [("drive", FULL_SPEED), STOP[1]]


def test_releasing_control_makes_safe_what_moved_and_more_may_be_sent(make: Make) -> None:
    link = make()
    link.send("arm", torque=9)
    link.hand_over()  # of the arm alone
    link.repeat("drive", hold=60, **FULL_SPEED)
    link.repeat("lamp", hold=60, level=1)
    link.run_until(lambda: "lamp" in link.names() and "drive" in link.names(), "both arrive")
    link.release_control()
    link.run_until(lambda: STOP[1] in link.messages(), "the safe value arrives")
    link.settle()
    before = link.messages()
    link.run(0.1)  # five times the rhythm of `drive`, and ten of the lamp's
    assert link.messages() == before
    assert ("arm", {"torque": 0}) not in before
    link.send("arm", torque=7)
    link.run_until(lambda: link.messages()[-1] == ("arm", {"torque": 7}), "it arrives")


def test_closing_while_the_port_is_away_counts_what_could_not_leave(make: Make) -> None:
    link = make()
    link.repeat("drive", hold=60, **FULL_SPEED)
    link.unplug()
    link.close()
    stats = link.stats()["send"]
    assert (stats["queued"], stats["expired"] >= 1) == (0, True)


# ---- the account, and the port ----------------------------------------------------------------------------------


def test_queued_frames_expire_when_the_port_goes_away(make: Make) -> None:
    link = make()
    taken = link.fill_queue("note", number=1, text=b"x" * 100)
    link.unplug()
    stats = link.stats()["send"]
    assert stats["expired"] + stats["aborted"] + stats["sent"] == taken
    assert stats["expired"] > taken / 2
    link.plug()
    link.send("lamp", level=1)
    link.run_until(lambda: link.names() == ["lamp"], "the port works again, and nothing old comes")
    assert link.stats()["reconnects"] >= 1


def test_a_lease_that_ends_while_the_port_is_away_sends_its_safe_value_when_it_is_back(make: Make) -> None:
    link = make()
    link.repeat("drive", hold=60, **FULL_SPEED)
    link.unplug()
    link.repeat("drive", hold=0.05, **FULL_SPEED)
    link.run(0.2)
    link.plug()
    link.run_until(lambda: len(link.messages()) >= 1, "the port works again")
    link.run(0.1)
    assert link.messages() == [STOP[1]]


def test_frames_older_than_max_age_expire(make: Make) -> None:
    link = make(manipulator(", max_age: 50 ms"))
    for number in range(60):
        link.send("note", number=number, text=b"x" * 100)  # 0.58 s of line
    link.run_until(lambda: link.stats()["send"]["queued"] == 0, "nothing waits any more")
    stats = link.stats()["send"]
    assert stats["expired"] > 40
    assert stats["sent"] + stats["expired"] == 60


def test_every_frame_that_was_taken_arrives_once_and_in_order(make: Make) -> None:
    link = make()
    for number in range(300):
        link.send("note", number=number, text=bytes(number % 50))
    link.run_until(lambda: len(link.messages()) == 300, "all arrive")
    assert [fields["number"] for _, fields in link.messages()] == list(range(300))


# ---- deadlines --------------------------------------------------------------------------------------------------


def is_given(link: Driver, frame: bytes) -> bool:
    """The MCU sends it. False: it was held back, or late: as old as its deadline when it was read, because the machine
    pauses."""
    given: list[object] = []
    before = link.stats()["late"] + link.stats()["held_back"]
    link.answer(frame)
    link.run_until(
        lambda: given.extend(link.receive()) or given or link.stats()["late"] + link.stats()["held_back"] > before, "it"
    )
    return len(given) == 1


def give(link: Driver, frame: bytes) -> None:
    """The MCU sends it, again where the machine pauses, until it is given."""
    if isinstance(link, VirtualDriver):
        assert is_given(link, frame)
    else:
        link.run_until(lambda: is_given(link, frame), "it is given")


def test_an_explicit_deadline_holds_its_message_back_until_recover(make: Make) -> None:
    link = make()
    pose = link.codec.encode("pose", x=1)
    give(link, pose)

    def is_held_back() -> bool:
        link.run_until(lambda: link.deadlines()["halt"], "silence strikes")
        return not is_given(link, pose) and link.stats()["held_back"] == 1

    if isinstance(link, VirtualDriver):
        assert is_held_back()
        assert link.state() == "up"  # the line is not silent
    else:
        link.run_until(is_held_back, "the next one, or the one after it where silence had struck before the first")
    assert link.receive() == []
    assert link.deadlines() == {"warn": True, "halt": True}

    def acts_again() -> bool:
        link.recover("halt")
        has_recovered = link.deadlines() == {"warn": False, "halt": False}
        link.answer(pose)
        link.run(0.05)
        return has_recovered and link.receive() != []

    if isinstance(link, VirtualDriver):
        assert acts_again()
    link.run_until(acts_again, "given again; silence may strike in between where the machine pauses")


def test_a_deadline_that_strikes_before_its_message_ever_came_holds_nothing_back(make: Make) -> None:
    link = make()
    link.run_until(lambda: link.deadlines()["halt"], "silence from the start strikes")
    give(link, link.codec.encode("pose", x=1))
    assert link.stats()["held_back"] == 0
    if isinstance(link, VirtualDriver):
        assert link.deadlines() == {"warn": False, "halt": False}  # elsewhere silence may have struck again


def test_a_message_as_old_as_its_deadline_is_late_where_the_process_stood_still() -> None:
    link = VirtualDriver(manipulator())
    pose = link.codec.encode("pose", x=1)
    link.answer(pose)
    link.run(0.1)
    assert len(link.receive()) == 1
    link.now += 299_000  # a little less than the shortest deadline: nobody looked
    link.answer(pose)
    assert (len(link.receive()), link.stats()["late"]) == (1, 0)
    link.run(0.1)
    link.now += 310_000
    link.answer(pose)
    assert (link.receive(), link.stats()["late"]) == ([], 1)
    assert link.deadlines() == {"warn": True, "halt": False}  # it put nothing off
    link.run(0.01)
    link.answer(pose)
    assert len(link.receive()) == 1
    assert link.deadlines() == {"warn": False, "halt": False}


def test_a_viewer_is_given_what_is_held_back(make: Make) -> None:
    link = make(hold_back=False)
    pose = link.codec.encode("pose", x=1)
    give(link, pose)

    def is_given_and_counted() -> bool:
        link.run_until(lambda: link.deadlines()["halt"], "silence strikes")
        before, given = link.stats()["held_back"], list[object]()
        link.answer(pose)
        link.run_until(lambda: given.extend(link.receive()) or bool(given), "it is given")
        return len(given) == 1 and link.stats()["held_back"] == before + 1

    if isinstance(link, VirtualDriver):
        assert is_given_and_counted()
    else:  # silence may have struck before the first came, which holds nothing back
        link.run_until(is_given_and_counted, "it is counted")
