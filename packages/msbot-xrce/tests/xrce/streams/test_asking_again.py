"""When a receiver asks again for what is missing, or may be."""

from __future__ import annotations

import pytest

from msbot_xrce.messages.submessage import Envelope
from msbot_xrce.streams.acknack_schedule import AcknackSchedule
from msbot_xrce.streams.receiving_in_order import ReliableInput
from msbot_xrce.streams.reordering import ReorderingDetector
from msbot_xrce.streams.session_output import SessionOutput
from msbot_xrce.streams.settings import Memory, SessionCounters, SessionSettings


class Rig:
    """One reliable stream, whose receiver asks; the round trip takes 2 ms."""

    def __init__(self, *, guesses: bool = True, measured: bool = True, is_stock: bool = True) -> None:
        counters = SessionCounters()
        settings = SessionSettings()
        self.sender = SessionOutput(Envelope(0x81, 1, 512, pads=False), counters, settings)
        if measured:
            self.sender.round_trip.measure(0.002)
        self.stream = ReliableInput(16, Memory(1 << 20), counters)
        self.asking = AcknackSchedule(
            self.sender, guesses=guesses, overtaking=ReorderingDetector(self.sender.round_trip) if is_stock else None
        )

    def take(self, number: int, now: float) -> None:
        """A message comes in."""
        if self.stream.accept(number, b"x"):
            while self.stream.next_held() is not None:
                pass
        self.asking.note(0x80, self.stream, now)

    def asked(self, until: float) -> list[tuple[int, int]]:
        """First number and bits of all questions until then; the time of each is in `times`."""
        self.times: list[float] = []
        found = []
        while (at := self.asking.next_at()) is not None and at <= until:
            self.asking.ask(at)
            for packet in self.sender.pull(at):
                found.append((int.from_bytes(packet[8:10], "little"), int.from_bytes(packet[10:12], "big")))
                self.times.append(at)
        return found


def test_a_gap_is_asked_for_again_and_not_for_ever() -> None:
    rig = Rig()
    rig.take(2, 1.0)
    asked = rig.asked(until=60.0)
    assert set(asked) == {(0, 0b11)}
    assert 10.0 < rig.times[-1] < 30.0, "as long as the link counts as lossy"
    assert len(asked) < 200
    waits = [later - sooner for sooner, later in zip([1.0, *rig.times], rig.times, strict=False)]
    assert waits[:3] == pytest.approx([waits[0]] * 3), "the first ones come soon"
    assert waits[3:7] == pytest.approx([2 * waits[0], 4 * waits[0], 8 * waits[0], 16 * waits[0]])


def test_on_a_lossy_link_what_may_follow_is_asked_for_a_few_times() -> None:
    rig = Rig()
    rig.take(1, 1.0)
    rig.take(0, 1.002)
    assert set(rig.asked(until=2.0)) == {(2, 0b1)}
    rig.take(2, 2.0)
    rig.asked(until=2.001)
    rig.take(3, 2.0015)
    asked = rig.asked(until=60.0)
    assert set(asked) == {(4, 0b1)}, "the question moves on with the stream"
    assert 6.0 < rig.times[-1] < 12.5, "as long as the link counts as lossy"
    assert 10 < len(asked) < 20, "and less and less often: mostly nothing follows"
    waits = [later - sooner for sooner, later in zip(rig.times, rig.times[1:], strict=False)]
    assert waits == sorted(waits)
    assert waits[-2] > rig.sender.heartbeat_s


def test_a_stock_client_that_was_never_measured_is_asked_less_and_less_often() -> None:
    rig = Rig(measured=False)
    rig.take(2, 1.0)
    assert set(rig.asked(until=60.0)) == {(0, 0b11)}
    waits = [later - sooner for sooner, later in zip([1.0, *rig.times], rig.times, strict=False)]
    assert waits[:6] == pytest.approx([0.02, 0.04, 0.08, 0.16, 0.32, 0.64])
    assert max(waits) == pytest.approx(0.64)


@pytest.mark.parametrize("guesses", [False, True])
def test_on_a_clean_link_or_a_bus_nothing_is_asked_for_that_may_not_exist(guesses: bool) -> None:
    rig = Rig(guesses=guesses)
    if not guesses:
        rig.sender.round_trip.note_loss(1.0)
    rig.take(0, 1.0)
    assert rig.asking.next_at() is None


def test_nothing_is_asked_again_while_the_round_trip_is_unknown() -> None:
    rig = Rig(measured=False, is_stock=False)
    rig.take(1, 1.0)
    assert rig.asking.next_at() is None


def test_the_answer_to_a_question_measures_the_round_trip() -> None:
    rig = Rig()
    rig.sender.round_trip.measure(0.4)
    before = rig.sender.round_trip.smoothed_s
    assert before is not None
    rig.take(1, 1.0)
    rig.take(0, 1.001)
    assert rig.sender.round_trip.smoothed_s == pytest.approx(0.001), "far shorter than known: that one had a loss in it"


def test_starting_over_forgets_all_questions() -> None:
    rig = Rig()
    rig.take(1, 1.0)
    assert rig.asking.next_at() is not None
    rig.asking.clear()
    assert rig.asking.next_at() is None
