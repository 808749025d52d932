"""What ends a program in good order: Ctrl-C, SIGTERM, the terminal that is closed; and what `nohup` means."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import Iterator

import pytest

from msbot.runtime.end_signals import on_end_signal


@pytest.fixture(autouse=True)
def as_before() -> Iterator[None]:
    """Every signal is handled afterwards as it was."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(number) for number in numbers]
    yield
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_each_of_them_ends_it(number: signal.Signals) -> None:
    async def main() -> None:
        ended = asyncio.Event()
        on_end_signal(ended.set)
        os.kill(os.getpid(), number)
        async with asyncio.timeout(60):
            await ended.wait()

    asyncio.run(main())


def test_with_nohup_it_outlives_its_terminal() -> None:
    async def main() -> None:
        ended = asyncio.Event()
        on_end_signal(ended.set)
        os.kill(os.getpid(), signal.SIGHUP)
        os.kill(os.getpid(), signal.SIGTERM)  # comes after it
        async with asyncio.timeout(60):
            await ended.wait()

    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    asyncio.run(main())
    assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
