"""The checks of a bus: T1 to T4 of the requirements, and that they notice what is wrong."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from random import Random

import pytest

from msbot.link.can.protocol import Frame
from msbot.link.can.selftest import CheckResult, selftest
from msbot.link.can.sim import SimBus, SimBusDriver
from msbot.runtime.virtual_time import run_virtual


def check(
    spoil: Callable[[SimBusDriver], None] = lambda driver: None,
    *,
    frames: int = 300,
    bitrate: int = 500_000,
    took_s: float | None = None,
) -> list[CheckResult]:
    """All checks on a simulated bus with something wrong."""

    async def main() -> list[CheckResult]:
        driver = SimBusDriver(SimBus(bitrate, random=Random(1)))
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
    results = check(lambda driver: driver.bus.set_bit_error_rate(1e-4), frames=500)
    assert [result.passed for result in results] == [True, False, True, False]
    assert results[1].words.startswith("2 frames came instead of 1, ")
    assert results[3].words == "frame 26 came twice: a disturbance of its last bit made the bus repeat it"


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
