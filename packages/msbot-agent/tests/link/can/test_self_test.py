"""The checks of a bus: T1 to T4 of the requirements, and that they notice what is wrong."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from random import Random

import pytest

from msbot.process.virtual_time import run_virtual
from msbot_agent.link.can.controller import CanBusInfo
from msbot_agent.link.can.protocol import Frame
from msbot_agent.link.can.self_test import CheckResult, selftest
from msbot_agent.link.can.sim import SimBus, SimBusDriver


def check(
    spoil: Callable[[SimBusDriver], None] = lambda driver: None,
    *,
    frames: int = 300,
    bitrate: int = 500_000,
    took_s: float | None = None,
    seed: int = 1,
) -> list[CheckResult]:
    """All checks on a simulated bus with something wrong."""

    async def main() -> list[CheckResult]:
        driver = SimBusDriver(SimBus(bitrate, random=Random(seed)))
        ends = driver.attach("A"), driver.attach("B")
        spoil(driver)
        results = await selftest(*ends, frames=frames)
        assert took_s is None or asyncio.get_running_loop().time() < took_s
        return results

    return run_virtual(main())


@pytest.mark.parametrize("bitrate", [125_000, 500_000, 1_000_000])
def test_t1_to_t4_pass_on_a_good_bus(bitrate: int) -> None:
    results = check(bitrate=bitrate, took_s=60.0)  # nobody waits for frames that have come
    assert [result.passed for result in results] == [True] * 4
    assert [result.words for result in results] == [
        "300 frames sent, 300 received",
        "300 times A5 and 5A with identifier 0x321",
        "300 questions, 300 answers",
        "300 frames each way at the same time, all in order",
    ]


def test_a_repetition_by_the_bus_itself_is_named() -> None:
    """The last bit of a frame, disturbed: the receivers have it already, the sender repeats it."""
    results = check(lambda driver: driver.bus.set_bit_error_rate(1e-4), frames=500, seed=42)
    assert [result.passed for result in results] == [True, False, True, False]
    assert results[1].words.startswith("2 frames came instead of 1, ")
    assert results[3].words == "frame 416 came twice: a disturbance of its last bit made the bus repeat it"


def test_a_single_frame_lost_at_the_receiver_is_found() -> None:
    first, *others = check(lambda driver: driver.bus.deafen(2, frames=1))
    assert not first.passed
    assert first.words == "frame 1 is a5 00 00 00 01 and not a5 00 00 00 00"
    assert all(other.passed for other in others)


def test_a_bus_that_is_cut_fails_every_check() -> None:
    results = check(lambda driver: driver.unplug("B"), frames=5)
    assert not any(result.passed for result in results)
    assert results[0].words == "0 frames came instead of 5, up to number 0"


def test_frames_of_others_are_left_alone() -> None:
    def babble(driver: SimBusDriver) -> None:
        node = driver.attach("other equipment")

        def send(_now: float) -> None:
            node.send(Frame(0x700, bytes(8)))

        node.attach(room=send)
        send(0.0)

    assert all(result.passed for result in check(babble, frames=100))


def test_losses_anywhere_are_noticed_in_each_check() -> None:
    def spoil(driver: SimBusDriver) -> None:
        for node in (1, 2):
            driver.bus.deafen(node, probability=0.1)

    assert not any(result.passed for result in check(spoil))


Fault = Callable[[int, int, Frame], list[tuple[float, Frame]]]
"""`(sender, how many it has sent, frame)`: what arrives, and how much later than usual."""


class Wire:
    """A controller of two that are joined directly; what arrives at the other one is up to a fault."""

    def __init__(self, number: int, fault: Fault, latency_s: float) -> None:
        self.info = CanBusInfo(f"wire {number}", 500_000)
        self.other: Wire | None = None
        self.is_open = False
        self.room_from = 0.0
        self._number, self._fault, self._latency_s, self._sent = number, fault, latency_s, 0
        self._last_at = 0.0

    def attach(
        self,
        *,
        frame: Callable[[Frame, float], None] | None = None,
        room: Callable[[float], None] | None = None,
        state: object = None,
    ) -> None:
        assert frame is not None
        assert room is not None
        self._heard, self._room = frame, room

    def has_room(self) -> bool:
        assert self.is_open
        return asyncio.get_running_loop().time() >= self.room_from

    def pending(self) -> int:
        return 0

    def send(self, frame: Frame) -> None:
        loop, other = asyncio.get_running_loop(), self.other
        assert other is not None
        for later_s, arriving in self._fault(self._number, self._sent, frame):
            self._last_at = max(self._last_at + 1e-6, loop.time() + self._latency_s + later_s)  # one after the other
            loop.call_at(self._last_at, lambda one: other._heard(one, loop.time()), arriving)
        self._sent += 1

    def restart(self) -> None: ...

    def full_until(self, at: float) -> None:
        """It has no room until then."""
        self.room_from = at
        asyncio.get_running_loop().call_at(at, lambda: self._room(at))

    async def run(self) -> None:
        self.is_open = True
        await asyncio.get_running_loop().create_future()


def joined(
    fault: Fault, frames: int = 4, latency_s: tuple[float, float] = (1e-4, 1e-4), stall_s: float = 0.0
) -> tuple[list[str], float]:
    """What the four checks say, `ok` for a good one, and how long they took."""

    async def main() -> tuple[list[str], float]:
        one, other = (Wire(number, fault, latency_s[number]) for number in (0, 1))
        one.other, other.other = other, one
        if stall_s:
            one.full_until(stall_s)
        results = await selftest(one, other, frames=frames)
        words = ["ok" if result.passed else result.words for result in results]
        return words, asyncio.get_running_loop().time()

    return run_virtual(main())


CHANGED = Frame(0x321, b"\x99")
TWICE = "came twice: a disturbance of its last bit made the bus repeat it"


@pytest.mark.parametrize(
    ("sender", "which", "fault", "check_number", "words"),
    [
        # The first one sends 4 frames in each check, the other one 4 in each but the first.
        (0, 1, "lost", 0, "frame 2 is a5 00 00 00 02 and not a5 00 00 00 01"),
        (0, 3, "lost", 0, "3 frames came instead of 4, up to number 3"),
        (0, 0, "twice", 0, f"frame 1 {TWICE}"),
        (0, 2, "twice", 0, f"frame 3 {TWICE}"),
        (0, 0, "changed", 0, "frame 1 is 99 and not a5 00 00 00 00"),
        (0, 3, "changed", 0, "frame 4 is 99 and not a5 00 00 00 03"),
        (0, 4, "lost", 1, "0 frames came instead of 1, up to number 0"),
        (0, 6, "changed", 1, "frame 3 is 99 and not a5"),
        (1, 1, "lost", 1, "0 frames came instead of 1, up to number 1"),
        (1, 3, "twice", 1, "2 frames came instead of 1, up to number 5"),
        (0, 9, "lost", 2, "1 frame came instead of 2, up to number 1"),
        (0, 10, "changed", 2, "frame 3 is 99 and not a5"),
        (1, 5, "lost", 2, "1 frame came instead of 2, up to number 1"),
        (1, 6, "changed", 2, "frame 3 is 99 and not 5a"),
        (0, 14, "changed", 3, "frame 3 is 99 and not 00 00 00 00 00 00 00 02"),
        (0, 15, "lost", 3, "3 frames came instead of 4, up to number 3"),
        (0, 13, "twice", 3, f"frame 2 {TWICE}"),
        (1, 8, "changed", 3, "frame 1 is 99 and not 00 00 00 00 00 00 00 00"),
        (1, 11, "lost", 3, "3 frames came instead of 4, up to number 3"),
        (1, 9, "twice", 3, f"frame 2 {TWICE}"),
    ],
)
def test_one_fault_is_named_by_its_check_and_troubles_no_other(
    sender: int, which: int, fault: str, check_number: int, words: str
) -> None:
    def spoiled(number: int, count: int, frame: Frame) -> list[tuple[float, Frame]]:
        if (number, count) != (sender, which):
            return [(0.0, frame)]
        return {"lost": [], "twice": [(0.0, frame), (0.0, frame)], "changed": [(0.0, CHANGED)]}[fault]

    expected = ["ok"] * 4
    expected[check_number] = words
    assert joined(spoiled)[0] == expected


def good(_number: int, _count: int, frame: Frame) -> list[tuple[float, Frame]]:
    return [(0.0, frame)]


@pytest.mark.parametrize("latency_s", [(1e-4, 1e-4), (0.02, 1e-4), (1e-4, 0.02)])
def test_a_good_bus_is_not_waited_for(latency_s: tuple[float, float]) -> None:
    words, took_s = joined(good, latency_s=latency_s)
    assert words == ["ok"] * 4
    assert took_s < 0.9, "4 pauses of 0.1 s, and the way there"


def test_what_comes_late_is_no_frame_of_the_next_check() -> None:
    def late(number: int, count: int, frame: Frame) -> list[tuple[float, Frame]]:
        return [(0.0, frame), (0.05, frame)] if count in (3, 7, 11) and number == 0 else [(0.0, frame)]

    words, _ = joined(late)
    assert words[0] == words[1] == words[3] == "ok"


def test_what_could_not_be_sent_in_a_check_is_not_sent_in_the_next() -> None:
    words, _ = joined(good, stall_s=1.3)  # the first check gives up after 1 s
    assert words == ["0 frames came instead of 4, up to number 0", "ok", "ok", "ok"]
