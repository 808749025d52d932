"""Functions that wait: `yield 1.0` lets one wait, and everything else go on; in virtual time.

What they do in a robot, in every home: `tests.homes`, program `waits`.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncGenerator, Awaitable, Callable, Generator

import pytest

from msbot.part.handler_guard import Guard, check_handler
from msbot.part.part import Part
from msbot.part.waiting import MOST_WAITING, SHORTEST_WAIT_S
from msbot.process.virtual_time import run_virtual
from msbot_xrce.errors import ConfigError, LocalProtocolError

Told = list[tuple[float, str]]


def play(story: Callable[[Guard, Callable[[str], None]], Awaitable[None]]) -> Told:
    """What a story told, and when."""
    told: Told = []

    async def main() -> None:
        loop = asyncio.get_running_loop()
        await story(Guard(lambda _: None), lambda words: told.append((round(loop.time(), 3), words)))

    run_virtual(main())
    return told


def test_it_waits_as_long_as_it_says_and_does_not_begin_twice() -> None:
    async def story(guard: Guard, tell: Callable[[str], None]) -> None:
        def walk() -> Generator[float]:
            tell("left")
            yield 1
            tell("right")
            yield 0.25
            tell("there")

        assert guard.call(walk)
        await asyncio.sleep(0.5)
        assert guard.call(walk)
        await asyncio.sleep(2.0)
        guard.call(walk)

    assert play(story) == [(0.0, "left"), (1.0, "right"), (1.25, "there"), (2.5, "left")]


def test_stop_holds_what_waits_and_lets_go_what_begins_meanwhile() -> None:
    async def story(guard: Guard, tell: Callable[[str], None]) -> None:
        def steps(name: str, wait_s: float) -> Callable[[], Generator[float]]:
            def run() -> Generator[float]:
                yield wait_s
                tell(name)

            return run

        guard.call(steps("due during STOP", 1.0))
        guard.call(steps("due after GO", 3.0))
        guard.waiting.hold()
        guard.call(steps("begun during STOP", 0.5))
        await asyncio.sleep(2.0)
        guard.waiting.release()
        await asyncio.sleep(2.0)

    assert play(story) == [(0.5, "begun during STOP"), (2.0, "due during STOP"), (3.0, "due after GO")]


def test_an_error_in_a_later_step_is_told_with_its_line_and_ends_it(caplog: pytest.LogCaptureFixture) -> None:
    async def story(guard: Guard, tell: Callable[[str], None]) -> None:
        def fall() -> Generator[float]:
            tell("goes")
            yield 0.5
            raise ZeroDivisionError("divided by nothing")

        def doze() -> Generator[object]:
            yield -1

        for function in (fall, doze):
            guard.call(function)
            await asyncio.sleep(1.0)
            guard.call(function)
            await asyncio.sleep(1.0)
        assert guard.errors == 4

    with caplog.at_level(logging.ERROR):
        assert play(story) == [(0.0, "goes"), (1.0, "goes")]
    (falls, dozes) = caplog.messages
    assert "in fall" in falls
    assert "divided by nothing" in falls
    assert "in doze" in dozes
    assert "yield waits for seconds, a number from 0 up: yield 0.5, not yield -1" in dozes


def test_one_that_never_waits_long_leaves_time_for_the_rest_and_is_ended_from_outside() -> None:
    async def story(guard: Guard, tell: Callable[[str], None]) -> None:
        turns = 0

        def spin() -> Generator[float]:
            nonlocal turns
            try:
                while True:
                    turns += 1
                    yield 0
            finally:
                tell("closed")

        def end_itself() -> Generator[float]:
            guard.waiting.end(end_itself)
            tell("ends")
            yield 1.0
            tell("never")

        guard.call(spin)
        guard.call(end_itself)
        await asyncio.sleep(1.0)
        assert 0 < turns <= 1.0 / SHORTEST_WAIT_S + 1
        guard.waiting.end_all()
        await asyncio.sleep(5.0)

    assert play(story) == [(0.0, "ends"), (1.0, "closed")]


def test_there_are_not_more_than_a_few_of_them() -> None:
    async def story(guard: Guard, tell: Callable[[str], None]) -> None:
        def another() -> Callable[[], Generator[float]]:
            def wait() -> Generator[float]:
                yield 1.0

            return wait

        assert all(guard.call(another()) for _ in range(MOST_WAITING))
        assert not guard.call(another())
        tell(str(guard.errors))

    assert play(story) == [(0.0, "1")]


def test_what_must_be_done_at_once_does_not_wait() -> None:
    part = Part("ABCD")

    def slow() -> Generator[float]:
        yield 1.0

    for decorator, name in ((part.safe_state, "safe_state"), (part.on_end, "on_end")):
        with pytest.raises(ConfigError, match=f"slow waits .* below @part.{name} must be done at once"):
            decorator(slow)
    with pytest.raises(LocalProtocolError, match="the part does not run: start slow in a function below"):
        part.start(slow)
    with pytest.raises(ConfigError, match="must take no arguments"):
        part.start(lambda message: message)  # type: ignore[arg-type,misc]  # a beginner's mistake

    async def later() -> AsyncGenerator[float]:
        yield 1.0

    with pytest.raises(ConfigError, match="plain function"):
        check_handler(later)
