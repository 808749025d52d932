"""What the benchmark of hours says about memory: the warm-up does not count, a leak does."""

import asyncio
from collections.abc import Callable
from typing import cast

import pytest

from bench import hours
from bench.hours import USUAL, WARM_S, WARM_UP, Look, Pace, growth
from bench.open_pages import Site
from msbot.process.virtual_time import run_virtual


def look(minute: float, master_mb: float, recorder_mb: float = 20.0) -> Look:
    return Look(60.0 * minute, master_mb, recorder_mb, 0.05, 100, 1.0)


class Robot:
    """Grows by 1 MB whenever it is used, in its warm-up only."""

    def __init__(self) -> None:
        self.memory_mb, self.began_at = 60.0, asyncio.get_running_loop().time()
        self.paces: list[Pace] = []

    def look(self) -> Look:
        return look((asyncio.get_running_loop().time() - self.began_at) / 60, self.memory_mb)

    async def use(self, _site: object, _done: object, _heard: object, pace: Pace) -> None:
        self.paces.append(pace)
        while True:
            await asyncio.sleep(60.0)
            self.memory_mb += pace == WARM_UP


def test_the_warm_up_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> str:
        robot = Robot()
        monkeypatch.setattr(hours, "use", robot.use)
        monkeypatch.setattr(asyncio, "to_thread", called)
        monkeypatch.setattr(asyncio.get_running_loop(), "add_signal_handler", lambda *_: None)
        seen, _, _ = await hours.watch(cast("hours.Eye", robot), cast("Site", None), 2.0, 12)
        assert [one.at_s for one in seen] == pytest.approx([WARM_S + 600.0 * number for number in range(13)], abs=1)
        assert robot.paces == [WARM_UP, USUAL]
        return growth(seen)

    words = run_virtual(main())
    assert words.startswith("After the warm-up: the master 74.0 to 74.0 MB, at most 74.0 (+0.00 MB an hour)")


async def called(function: Callable[[], Look]) -> Look:
    return function()


@pytest.mark.parametrize("mb_per_hour", [6.0, -3.0])
def test_what_grows_is_told_with_its_rate(mb_per_hour: float) -> None:
    looks = [look(minute, 100.0, 20.0 + mb_per_hour * minute / 60) for minute in range(0, 130, 10)]
    words = growth(looks)
    assert "the master 100.0 to 100.0 MB, at most 100.0 (+0.00 MB an hour)" in words
    assert words.endswith(f"({mb_per_hour:+.2f} MB an hour).")
