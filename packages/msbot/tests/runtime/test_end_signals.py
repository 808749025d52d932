"""What ends a program in good order: Ctrl-C, SIGTERM, the terminal that is closed; and what `nohup` means."""

from __future__ import annotations

import asyncio
import os
import signal
import time
from collections.abc import Iterator

import pytest

from msbot_agent.process import end_signals
from msbot_agent.process.end_signals import on_end_signal


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


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("sleeps", [False, True])
def test_code_of_others_that_never_returns_is_broken_off(
    number: signal.Signals, sleeps: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(end_signals, "GRACE_S", 0.05)
    monkeypatch.setattr(end_signals, "TWICE_S", 0.0)

    def never_returns() -> None:
        os.kill(os.getpid(), number)
        while True:
            if sleeps:
                time.sleep(1000)

    async def main() -> None:
        on_end_signal(lambda: None, even_if_stuck=True)
        asyncio.get_running_loop().call_soon(never_returns)
        await asyncio.Event().wait()

    with pytest.raises(KeyboardInterrupt):
        asyncio.run(main())


def test_a_loop_that_comes_round_ends_in_good_order_however_often_it_is_told() -> None:
    async def main() -> None:
        ended = asyncio.Event()
        on_end_signal(ended.set, even_if_stuck=True)
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)  # a terminal and a program around this one may both pass it on
        async with asyncio.timeout(60):
            await ended.wait()

    asyncio.run(main())
