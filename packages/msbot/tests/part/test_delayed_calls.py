"""`part.after`: once, while the part is active, and bounded."""

import asyncio

import pytest

from msbot.part import Part
from msbot.part.handler_guard import Guard
from msbot.part.program import MOST_DELAYED, After
from msbot.process.virtual_time import run_virtual
from msbot_xrce.errors import ConfigError, LocalProtocolError


def test_it_is_called_once_and_not_after_it_was_cancelled() -> None:
    calls: list[float] = []

    async def main() -> None:
        loop = asyncio.get_running_loop()
        guard = Guard(lambda _: None)
        for delay, cancelled in ((0.0, False), (2.5, False), (1.0, True)):
            after = After(delay, lambda: calls.append(loop.time()))
            after.start(guard)
            if cancelled:
                after.cancel()
        await asyncio.sleep(60)

    run_virtual(main())
    assert calls == [0.0, 2.5]


def test_what_cannot_be_called_later_is_refused_where_it_is_written() -> None:
    part = Part("ABCD")
    with pytest.raises(ConfigError, match=r"after\(-1\): the time must be 0 seconds or more"):
        part.after(-1, print)
    with pytest.raises(ConfigError, match="must be 0 seconds or more"):
        part.after("1")  # type: ignore[call-overload]
    with pytest.raises(ConfigError, match="must take no arguments"):
        part.after(1.0)(lambda _: None)  # type: ignore[type-var]
    for _ in range(MOST_DELAYED):
        part.after(1.0, lambda: None)
    with pytest.raises(LocalProtocolError, match="100 functions wait for their time already"):
        part.after(1.0, lambda: None)
