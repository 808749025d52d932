"""One error in place of the group that a `TaskGroup` makes of it, in every version of Python."""

from __future__ import annotations

import asyncio

import pytest

from msbot_agent.process.end_signals import ungrouped
from msbot_xrce.errors import ConfigError, LinkDown, MsbotError
from tools.sources import source_files


async def fail(*errors: BaseException) -> None:
    async def one(error: BaseException) -> None:
        raise error

    with ungrouped(MsbotError):
        async with asyncio.TaskGroup() as tasks:
            for error in errors:
                tasks.create_task(one(error))


async def test_the_first_error_comes_out_by_itself_without_a_cause() -> None:
    wanted = LinkDown("no such port")
    with pytest.raises(LinkDown, match="no such port") as caught:
        await fail(wanted, ConfigError("later"))
    assert caught.value is wanted
    assert caught.value.__suppress_context__


async def test_groups_within_groups() -> None:
    with pytest.raises(LinkDown, match="deep"):
        await fail(ExceptionGroup("outer", [ExceptionGroup("inner", [LinkDown("deep")])]))


async def test_what_is_no_error_of_ours_stays_a_group() -> None:
    with pytest.raises(ExceptionGroup) as caught:
        await fail(LinkDown("ours"), ZeroDivisionError("a mistake in the program"))
    assert len(caught.value.exceptions) == 2


async def test_an_error_without_a_group_comes_out_as_it_is() -> None:
    with pytest.raises(ConfigError, match="plain"), ungrouped(MsbotError):
        raise ConfigError("plain")


def test_nobody_writes_it_the_way_that_older_versions_do_not_have() -> None:
    assert [path.name for path in source_files() if "except* " in path.read_text("utf-8")] == []
