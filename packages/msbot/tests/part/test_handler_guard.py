"""A student's mistakes: refused when handed over, reported once with file and line, never fatal."""

import asyncio
import logging

import pytest

from msbot.part.handler_guard import Guard, check_handler
from msbot.process.virtual_time import run_virtual
from msbot_xrce.errors import ConfigError


def one(message: object) -> None:
    """Takes the message."""


def none() -> None:
    """Takes nothing."""


def test_a_handler_with_the_right_arguments_is_taken() -> None:
    assert check_handler(none) == "none"
    assert check_handler(one, "message") == "one"
    assert check_handler(print, "message") == "print"


@pytest.mark.parametrize(
    ("function", "arguments", "words"),
    [
        (one, "", "one must take no arguments: write `def one()`"),
        (none, "message", "none must take one argument, the message: write `def none(message)`"),
        (3, "", "a handler must be a function, not 3"),
    ],
)
def test_a_handler_with_other_arguments_is_refused(function: object, arguments: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        check_handler(function, arguments)  # type: ignore[arg-type]  # that is the mistake
    assert str(caught.value) == words


def test_an_async_handler_is_refused() -> None:
    async def tick() -> None:
        """Would never be awaited."""

    with pytest.raises(ConfigError, match="must be a plain function"):
        check_handler(tick)


def test_an_error_is_reported_once_with_file_and_line(caplog: pytest.LogCaptureFixture) -> None:
    def broken() -> None:
        raise ZeroDivisionError("division by zero")

    async def main() -> Guard:
        guard = Guard(lambda _: None)
        for _ in range(3):
            guard.call(broken)
        return guard

    with caplog.at_level(logging.INFO, "msbot.part"):
        guard = run_virtual(main())
    assert guard.errors == 3
    line = broken.__code__.co_firstlineno + 1
    said = [record.getMessage() for record in caplog.records]
    assert said == [
        f"test_handler_guard.py:{line} in broken: ZeroDivisionError: division by zero (said once, counted from now on)"
    ]


def test_the_same_line_may_fail_in_two_ways(caplog: pytest.LogCaptureFixture) -> None:
    errors = iter([ValueError("1"), TypeError("2"), ValueError("3")])

    def broken() -> None:
        raise next(errors)

    async def main() -> None:
        guard = Guard(lambda _: None)
        for _ in range(3):
            guard.call(broken)

    run_virtual(main())
    assert sum(record.levelname == "ERROR" for record in caplog.records) == 2


def test_a_mistake_in_the_program_goes_to_the_owner_with_its_place() -> None:
    told: list[ConfigError] = []

    def broken() -> None:
        raise ConfigError("no such port")

    async def main() -> None:
        Guard(told.append).call(broken)

    run_virtual(main())
    assert [str(error) for error in told] == [
        f"test_handler_guard.py:{broken.__code__.co_firstlineno + 1} in broken: no such port"
    ]


def test_a_slow_handler_is_reported_once(caplog: pytest.LogCaptureFixture) -> None:
    durations = iter([2.0, 3.0])

    def slow() -> None:
        loop = asyncio.get_running_loop()
        loop._now += next(durations)  # type: ignore[attr-defined]  # as if it had slept

    async def main() -> None:
        guard = Guard(lambda _: None)
        guard.call(slow)
        guard.call(slow)

    run_virtual(main())
    assert [record.getMessage() for record in caplog.records] == [
        "slow: took 2.0 s, and the part cannot beat meanwhile: keep it below 0.5 s"
    ]


def test_a_slow_function_of_msbot_is_told_of_by_its_part(caplog: pytest.LogCaptureFixture) -> None:
    def _say() -> None:
        loop = asyncio.get_running_loop()
        loop._now += 0.8  # type: ignore[attr-defined]  # as on a computer that has much else to do
        assert guard.running is not None
        running.append(guard.running[0])

    _say.__module__ = "msbot.sim.model_part"
    guard, running = Guard(lambda _: None), list[str]()

    async def main() -> None:
        guard.part = "SONAR-1"
        guard.call(_say)

    run_virtual(main())
    assert running == ["a step of SONAR-1"]
    assert [record.getMessage() for record in caplog.records] == [
        "SONAR-1: one of its steps took 0.8 s, and it cannot beat meanwhile: this computer may be too busy"
    ]


def test_reports_are_bounded(caplog: pytest.LogCaptureFixture) -> None:
    guard = Guard(lambda _: None)
    for number in range(500):
        guard.report(f"place {number}", "wrong")
    assert len(caplog.records) == 100
