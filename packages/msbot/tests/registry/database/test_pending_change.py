"""A person's change on its way to the database: what a thread or an event loop that waits for it gets."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from msbot.registry.database.database_writer import PendingChange
from msbot_xrce.errors import RegistryError


def pending(given_up: list[PendingChange[str]]) -> PendingChange[str]:
    def give_up(job: PendingChange[str]) -> str:
        given_up.append(job)
        return "given up"

    return PendingChange(give_up, lambda _: "not called here", 1.0)


async def by_thread(job: PendingChange[str], limit_s: float) -> str:
    return job.wait(limit_s)


async def by_loop(job: PendingChange[str], limit_s: float) -> str:
    return await job.stored(limit_s)


@pytest.mark.parametrize("waiting", [by_thread, by_loop])
async def test_what_was_made_is_returned_and_what_failed_is_raised(
    waiting: Callable[[PendingChange[str], float], Awaitable[str]],
) -> None:
    given_up: list[PendingChange[str]] = []
    made, failed = pending(given_up), pending(given_up)
    made.done.set_result("made")
    failed.done.set_exception(RegistryError("there is no such slot"))
    assert await waiting(made, 1.0) == "made"
    with pytest.raises(RegistryError, match="there is no such slot"):
        await waiting(failed, 1.0)
    assert given_up == []


@pytest.mark.parametrize("waiting", [by_thread, by_loop])
async def test_whoever_waits_in_vain_gives_up(
    waiting: Callable[[PendingChange[str], float], Awaitable[str]],
) -> None:
    given_up: list[PendingChange[str]] = []
    job = pending(given_up)
    assert await waiting(job, 0.0) == "given up"
    assert given_up == [job]


async def test_what_a_loop_has_given_up_is_cancelled_and_the_writer_will_skip_it() -> None:
    job = pending([])
    await job.stored(0.0)
    await asyncio.sleep(0)
    assert not job.done.set_running_or_notify_cancel()
