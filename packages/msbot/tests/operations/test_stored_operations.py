"""The same operations on a database that no master uses; they count from the robot's next start."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest

from msbot.config import load_blueprint, load_library
from msbot.operations.dispatch import Operations, perform, stored_operations
from msbot.registry import open_registry
from msbot_xrce.errors import ConfigError, RegistryError
from tests.operations.stage import AA_IS_A_DIAL, Deeds, Stage, play

PARTS = ("AA=DIAL", "BB=EFGH", "DD=EFGH", "XX=NOPE")


async def nothing(_stage: Stage) -> None:
    await asyncio.sleep(1.0)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A robot that ran once: AA, BB and CC's slots; DD stood by, XX was refused."""
    play(tmp_path, nothing, AA_IS_A_DIAL, parts=PARTS)
    return tmp_path


def change(folder: Path, act: Callable[[Deeds, Operations], Awaitable[object]]) -> None:
    with open_registry(folder / "robot.db") as registry:
        operations = stored_operations(registry, registry.robots.all()[0])
        asyncio.run(_awaited(act(Deeds(operations), operations)))


async def _awaited(deed: Awaitable[object]) -> None:
    await deed


def test_a_swap_counts_from_the_next_start(folder: Path) -> None:
    change(folder, lambda do, _: do.swap("bb", "DD", who="ann"))

    async def scene(stage: Stage) -> None:
        await asyncio.sleep(1.0)
        assert (stage.slot("DD"), stage.state("BB")) == ("BB", "standby")
        await stage.do.undo(who="bob")
        await asyncio.sleep(1.0)
        assert (stage.slot("BB"), stage.state("DD")) == ("BB", "standby")

    play(folder, scene, parts=("DD=EFGH", "BB=EFGH"))


def test_release_adopt_and_undo(folder: Path) -> None:
    async def act(do: Deeds, operations: Operations) -> None:
        assert (await do.release("BB", who="ann")).words == "BB is released from slot BB"
        with pytest.raises(ConfigError, match="no part belongs in slot BB"):
            await do.release("BB", who="ann")
        done = await do.adopt("DD", "BB", who="ann")
        assert done.edit_id == (await operations.undoing.read(1))[0].id
        with pytest.raises(ConfigError, match="DD belongs in slot BB already"):
            await do.swap("BB", "DD", who="ann")
        await do.undo(who="ann")
        await do.undo(who="ann")
        with pytest.raises(ConfigError, match="BB belongs in slot BB already"):
            await do.swap("BB", "BB", who="ann")

    change(folder, act)


def test_blocks_settings_and_wires(folder: Path) -> None:
    async def act(do: Deeds, operations: Operations) -> None:
        await do.block("BB", "loud", who="ann")
        await do.block("NOPE", "", who="ann")
        await do.unblock("BB", who="ann")
        with pytest.raises(ConfigError, match="BB is not blocked"):
            await do.unblock("BB", who="ann")
        await do.set("AA", "period_s", "2", who="ann")
        assert [(value.value, value.origin) for value in await operations.settings.read("AA")] == [(2, "hand")]
        await do.reset("AA", "period_s", who="ann")
        with pytest.raises(ConfigError, match="is not set by hand"):
            await do.reset("AA", "period_s", who="ann")
        await do.unbind("HelloWorldTopic_1_to_2", "BB.in", who="ann")
        await do.bind("HelloWorldTopic_1_to_2", "HelloWorld", "AA.out", ["BB.in"], who="ann")

    change(folder, act)


@pytest.mark.parametrize(
    ("act", "words"),
    [
        (lambda do: do.adopt("DD", who="a"), "it is not known which slots are empty: name one with --slot"),
        (lambda do: do.adopt("XX", "CC", who="a"), "XX is a part NOPE, and slot CC takes WXYZ: strangers can be"),
        (lambda do: do.swap("BB", "EFGH", who="a"), "2 parts are known as 'EFGH': name one by its UID: "),
        (lambda do: do.swap("BB", "ZZ", who="a"), "no part is known as 'ZZ'; seen so far: "),
        (lambda do: do.swap("ZZ", "DD", who="a"), "the robot has no slot 'ZZ'; there are AA, BB, CC"),
        (lambda do: do.bind("t", "HelloWorld", "out", who="a"), "'out' is not a port"),
    ],
)
def test_a_mistake_is_told(act: Callable[[Deeds], Awaitable[object]], words: str, folder: Path) -> None:
    async def mistaken(do: Deeds, operations: Operations) -> None:
        with pytest.raises(ConfigError) as caught:
            await act(do)
        assert words in str(caught.value)
        assert await operations.undoing.read(9) == []

    change(folder, mistaken)


def test_what_needs_a_master_says_so(folder: Path) -> None:
    async def act(do: Deeds, operations: Operations) -> None:
        answer = await perform(operations, {"do": "stop", "who": "ann"})
        assert answer == {"error": "stop needs the robot's master, and it does not run: start it, `msbot master`"}
        answer = await perform(operations, {"do": "remove_slot", "args": {"slot": "AA"}, "who": "ann"})
        assert str(answer["error"]).startswith("remove slot needs the robot's master")

    change(folder, act)


def test_a_robot_that_a_master_runs_is_left_alone(folder: Path) -> None:
    library = load_library(folder / "library")
    with open_registry(folder / "robot.db") as first, open_registry(folder / "robot.db", busy_timeout_s=0.05) as second:
        first.runs.begin(first.robots.apply_blueprint(load_blueprint(folder / "robot.toml", library), library))
        with pytest.raises(RegistryError, match="is being run by another msbot master"):
            stored_operations(second, second.robots.all()[0])
