"""How a command finds its robot, and what the commands that change one print."""

from __future__ import annotations

import asyncio
import sqlite3
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, closing
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from msbot.cli.change import robot_access
from msbot.cli.change.robot_access import master_details, perform, running_master
from msbot.operations.dispatch import perform as perform_request
from msbot.registry.records import database_identity
from msbot_agent.agent import RunningProcess, StatusServer, status_reader
from msbot_agent.agent.status_files import StatusFile
from msbot_agent.cli import msbot
from msbot_xrce.errors import ConfigError, MsbotError
from tests.operations.stage import AA_IS_A_DIAL, Stage, play

PATIENCE_S = 60.0


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "run").mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("robot.db", "./robot.db"),
        ("robot.db", "sqlite:///robot.db"),
        ("robot.db", "folder/../robot.db"),
        ("postgresql://ann:secret@host/robot", "postgresql+psycopg://host/robot"),
    ],
)
def test_a_database_is_recognised_in_other_words(one: str, other: str) -> None:
    assert database_identity(one) == database_identity(str(Path(other)) if "://" not in other else other)
    assert "secret" not in database_identity(one)


def command(*words: str) -> str:
    """Run a command as a user does; what it prints, or says is wrong."""
    try:
        done = CliRunner().invoke(msbot, list(words), catch_exceptions=False)
    except MsbotError as error:
        return f"msbot: {error}"
    return done.output.strip()


@asynccontextmanager
async def answering(stage: Stage, db: str, robot: str = "") -> AsyncIterator[None]:
    """The robot answers other processes, as that of `msbot master` does."""
    server = StatusServer(
        stage.master.agent,
        what="master",
        name=f"{stage.master.profile.name} V1",
        details=lambda: master_details(stage.master, db) | ({"robot": robot} if robot else {}),
        control=lambda request: perform_request(stage.operations, request),
    )
    task = asyncio.create_task(server.run())
    while server.path is None:  # noqa: ASYNC110 - a file makes no sound
        await asyncio.sleep(0.001)
    try:
        yield
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def typed(*words: str) -> str:
    return await asyncio.to_thread(command, *words)


def scene_with(folder: Path, act: Callable[[Stage], object]) -> None:
    """A robot that answers, with AA, BB and a spare DD in it."""

    async def scene(stage: Stage) -> None:
        async with answering(stage, str(folder / "robot.db")):
            done = act(stage)
            if asyncio.iscoroutine(done):
                await done

    play(folder, scene, AA_IS_A_DIAL, parts=("AA=DIAL", "BB=EFGH", "DD=EFGH"))


def test_the_commands_change_the_robot_that_runs(tmp_path: Path) -> None:
    async def act(stage: Stage) -> None:
        assert await typed("swap", "BB", "--to", "DD") == (
            "DD takes slot BB in place of BB, which stands by (`msbot undo 1` takes it back)"
        )
        assert stage.slot("DD") == "BB"
        assert (await typed("undo")).startswith("change 1 undone: ")
        assert stage.slot("BB") == "BB"
        assert (await typed("release", "BB")).startswith("BB is released from slot BB")
        assert stage.slot("DD") == "BB"
        assert (await typed("set", "AA", "period_s", "0.5")).startswith("period_s of AA: 1 s -> 0.5 s")
        assert "hand, " in await typed("set", "AA")
        assert "(the library's)" in await typed("set", "AA", "period_s", "--reset")
        assert (await typed("set", "AA", "period_s")).splitlines()[1].split()[:2] == ["period_s", "1"]
        assert "2 parts are known as 'BB'" in await typed("block", "BB")  # one by name, one by slot
        assert "is blocked: loud" in await typed("block", "DD", "--reason", "loud")
        assert stage.slot("BB") == "BB"  # it stood by, and is a spare like any other by now
        assert "may come in again" in await typed("unblock", "DD")
        assert "within 5 s gets slot CC" in await typed("adopt", "--slot", "CC", "--window", "5")
        assert "for 9 s parts of any kind" in await typed("adopt", "BB", "--slot", "CC", "--window", "9")
        assert stage.slot("BB") == "CC"
        assert await typed("identify", "AA") == "AA is told to show itself"
        topic = "HelloWorldTopic_1_to_2"
        assert (await typed("unbind", topic, "BB.in")).startswith(f"BB.in is taken off topic {topic}")
        assert "topic" in await typed("bind", topic, "--type", "HelloWorld", "--to", "BB.in", "--best-effort")
        listed = (await typed("undo", "--list")).splitlines()
        assert "change 1 undone" in "\n".join(listed)
        assert sum("(undone)" in line for line in listed) == 1

    scene_with(tmp_path, act)


def test_stop_waits_until_all_have_confirmed_it(tmp_path: Path) -> None:
    async def act(stage: Stage) -> None:
        said = (await typed("stop", "--reason", "fire")).splitlines()
        assert said[0].startswith("STOP: all 2 parts have confirmed it within ")
        assert stage.parts["AA"].stopped
        assert (await typed("go")).startswith("STOP is over")

    scene_with(tmp_path, act)


def test_a_mistake_of_the_person_is_said_by_the_command(tmp_path: Path) -> None:
    async def act(stage: Stage) -> None:
        assert await typed("release", "CC") == "msbot: slot CC is empty: there is nothing to release"
        assert "slot AA has no parameter 'x'; there are period_s" in await typed("set", "AA", "x")
        assert "slot BB has no parameters" in await typed("set", "BB")
        assert "--reset takes SLOT and NAME" in await typed("set", "AA", "--reset")
        assert "2 masters" not in await typed("why", "DD", "--robot", "MSBOT_MASTER")

    scene_with(tmp_path, act)


def test_why_says_how_the_part_stands_now(tmp_path: Path) -> None:
    async def act(stage: Stage) -> None:
        said = await typed("why", "DD")
        assert "checking -> standby: every fitting slot is taken" in said
        assert said.splitlines()[-1].startswith("now: DD (EFGH) is standby since"), said
        assert stage.state("DD") == "standby"

    scene_with(tmp_path, act)


def test_what_the_master_has_said_is_seen_by_who_reads_the_database(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def act(stage: Stage) -> None:
        storage, asked = stage.registry.storage, threading.Event()
        flush = storage.flush

        def slow_disk(_: object) -> None:
            assert asked.wait(PATIENCE_S)

        def asked_for(timeout_s: float = 10.0) -> bool:
            asked.set()
            return flush(timeout_s)

        monkeypatch.setattr(storage, "flush", asked_for)
        reading = (("DD", ("why", "DD"), "standby -> lost"), ("BB", ("parts", "--json"), '"state": "lost"'))
        for name, words, lost in reading:
            storage.writer.put(slow_disk)
            stage.pull(name)
            await asyncio.sleep(30.0)
            assert lost in await typed(*words)
            asked.clear()

    scene_with(tmp_path, act)


def test_what_is_not_stored_is_said_by_who_reads_the_database(tmp_path: Path) -> None:
    async def act(stage: Stage) -> None:
        with closing(sqlite3.connect(tmp_path / "robot.db", isolation_level=None)) as other:
            other.execute("BEGIN IMMEDIATE")
            stage.pull("DD")
            await asyncio.sleep(30.0)
            assert not await asyncio.to_thread(stage.registry.storage.flush), "its thread has met the lock"
            for words in (("why", "DD"), ("parts", "--json"), ("robots", "--json")):
                assert "what follows may be older than the robot: the database" in await typed(*words)

    scene_with(tmp_path, act)


def test_why_asks_the_master_when_the_database_cannot_be_read(tmp_path: Path) -> None:
    async def act(stage: Stage) -> None:
        await asyncio.to_thread(stage.registry.storage.flush)
        (tmp_path / "robot.db").rename(tmp_path / "away.db")
        (tmp_path / "robot.db").write_text("this is not a database, and long enough to be looked at")
        said = await typed("why", "DD")
        (tmp_path / "away.db").replace(tmp_path / "robot.db")
        assert "is not a database" in said
        assert "DD (EFGH) is standby since" in said
        assert "  - slot: every fitting slot is taken" in said

    scene_with(tmp_path, act)


def test_which_robot_is_meant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def act(stage: Stage) -> None:
        async with answering(stage, "/elsewhere/robot.db", "OTHER"):

            def look() -> None:
                here = running_master(None, None)  # robot.db of this folder
                assert here is not None
                assert here.details["robot"] == "MSBOT_MASTER"
                other = running_master("/elsewhere/robot.db", None)
                assert other is not None
                assert other.details["robot"] == "OTHER"
                assert running_master(None, "OTHER") is None
                monkeypatch.chdir("/")
                with pytest.raises(ConfigError, match="2 masters run here: say which robot is meant with --robot"):
                    running_master(None, None)
                named = running_master(None, "OTHER")
                assert named is not None

            await asyncio.to_thread(look)

    scene_with(tmp_path, act)


def test_while_nobody_runs_the_database_is_changed(tmp_path: Path) -> None:
    scene_with(tmp_path, lambda _: None)
    assert command("release", "BB").startswith("BB is released from slot BB")
    assert command("undo").startswith("change 1 undone")
    assert "NOT delivered: no master of this robot runs here" in command("stop")
    assert "has no robot 'NOBODY'; there are MSBOT_MASTER" in command("undo", "--robot", "NOBODY")
    assert perform("robot.db", None, "edits", {})["edits"]


def test_without_a_robot_there_is_nothing_to_change() -> None:
    assert command("release", "BB") == (
        "msbot: no master runs here, and there is no database robot.db: `msbot master robot.toml` or `msbot apply "
        "robot.toml` makes one; name another one with --db"
    )


def test_every_command_that_changes_a_robot_can_be_told_which() -> None:
    for name in (
        "adopt",
        "swap",
        "release",
        "block",
        "unblock",
        "set",
        "bind",
        "unbind",
        "undo",
        "identify",
        "stop",
        "why",
    ):
        found = msbot.get_command(click.Context(msbot), name)
        assert found is not None
        assert {"db", "robot"} <= {param.name for param in found.params}


def test_a_robot_that_runs_out_of_sight_is_told_as_that(tmp_path: Path) -> None:
    async def act(stage: Stage) -> None:
        said = await typed("identify", "AA", "--db", str(tmp_path / "robot.db"))
        assert said.startswith("msbot: robot MSBOT_MASTER runs, but its master is not among the programs in ")
        assert "XDG_RUNTIME_DIR of the master" in said
        assert "another --db" not in said

    play(tmp_path, act, parts=("AA=ABCD",))


def test_a_database_of_another_name_is_named(tmp_path: Path) -> None:
    (tmp_path / "r.db").touch()
    assert command("parts") == "msbot: there is no database robot.db; name the one that is meant: --db r.db"


def test_the_connection_outlasts_the_call_that_it_carries(monkeypatch: pytest.MonkeyPatch) -> None:
    patience: list[float] = []

    def asked(file: object, request: object, patience_s: float) -> dict[str, object]:
        patience.append(patience_s)
        return {"words": "done"}

    master = RunningProcess(StatusFile(Path("x"), 1, "x", 1), "master", "R", {"robot": "R"})
    monkeypatch.setattr(status_reader, "_ask", asked)
    monkeypatch.setattr(robot_access, "running_processes", lambda: [master])
    assert command("call", "a.b", "1", "--seconds", "30") == command("call", "a.b", "1") == "done"
    assert patience == [status_reader.ANSWER_S + 30, status_reader.ANSWER_S]
