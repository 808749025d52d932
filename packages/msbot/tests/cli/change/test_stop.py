"""What `msbot stop` and `msbot go` say: what the masters have said, no more, and whom it did not reach."""

from __future__ import annotations

import asyncio
import json
import os
import time
from collections.abc import Callable, Coroutine
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.cli.change import stop_commands as stop_route
from msbot.cli.change.robot_access import master_details
from msbot.cli.change.stop_commands import _words
from msbot.master import StopSocket
from msbot.master.stop_socket import answer_of, fitting
from msbot.pnp import StopStatus
from msbot.pnp.emergency_stop import StopConfirmation
from msbot.stop.socket_folders import IS_THERE
from msbot.stop.socket_names import own_group
from msbot.stop.stop_listener import StopListener
from msbot.stop.stop_request import ask_masters
from tests.cli.change.test_robot_access import PATIENCE_S, answering, command, typed
from tests.operations.stage import Stage, play
from tests.runtime.stop_stage import StopsWhen, own_places, stuck_master

needs_sockets = pytest.mark.skipif(not IS_THERE, reason="this system has no Unix sockets")


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own_places(tmp_path, monkeypatch)
    (tmp_path / "run").mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    monkeypatch.chdir(tmp_path)


def with_socket(folder: Path, act: Callable[[Stage], Coroutine[None, None, None]]) -> None:
    """A robot that takes STOP by its socket, as that of `msbot master` does."""

    async def scene(stage: Stage) -> None:
        sock = StopSocket(stage.master, lambda: master_details(stage.master, str(folder / "robot.db")))
        task = asyncio.create_task(sock.run())
        await asyncio.sleep(0.01)  # it listens
        try:
            await act(stage)
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    play(folder, scene, parts=("AA=ABCD", "BB=EFGH"))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("stop",), "NOT delivered: no master of this robot runs here"),
        (("go",), "NOT delivered: no master of this robot runs here"),
        (("stop", "--status"), "whether STOP holds is not known: no master of this robot runs here"),
    ],
)
@pytest.mark.parametrize("has_database", [False, True])
def test_without_a_master_the_database_is_not_even_opened(
    words: tuple[str, ...], said: str, has_database: bool, tmp_path: Path
) -> None:
    if has_database:
        (tmp_path / "robot.db").write_text("whoever opens this fails")
    assert said in command(*words)


@needs_sockets
def test_a_master_that_stands_still_beside_one_that_answers_is_told_of_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stop_route, "ask_masters", lambda request, group: ask_masters(request, PATIENCE_S, group))
    clock = StopsWhen(monkeypatch)
    monkeypatch.setattr("msbot.cli.change.stop_commands.PATIENCE_S", 0.0)
    stuck_one = f"BUGGY X9 (process {os.getpid()}): it runs and does not answer"

    async def act(stage: Stage) -> None:
        with stuck_master("BUGGY X9", own_group()) as stuck:
            clock.answers_wanted = 1
            said = await typed("stop")
            assert f"NOT delivered to {stuck_one}; cut the power" in said
            latest = time.monotonic() + PATIENCE_S
            while not stage.parts["AA"].stopped:  # it hears of it a moment after the answer
                assert time.monotonic() < latest
                await asyncio.sleep(0.01)
            clock.answers_wanted += 1
            assert f"not known: {stuck_one}" in await typed("stop", "--status")
            clock.answers_wanted = 1 << 30
            assert "have confirmed" in await typed("stop", "--robot", stage.master.profile.name), "it is not meant"
            assert "STOP is over" in await typed("go", "--robot", stage.master.profile.name)
            assert requests_at(stuck) == ["stop", "status"]

    with_socket(tmp_path, act)


@needs_sockets
def test_the_status_of_stop_names_its_robot(tmp_path: Path) -> None:
    async def act(stage: Stage) -> None:
        name, serial = stage.master.profile.name, stage.master.profile.serial_number
        assert await typed("stop", "--status") == f"no STOP holds at {name} {serial}"
        await typed("stop", "--reason", "a finger")
        told = await typed("stop", "--status")
        assert f"STOP 1 at {name} {serial} since " in told
        assert told.splitlines()[0].endswith(": a finger")
        (one,) = json.loads(await typed("stop", "--status", "--json"))["robots"]
        assert (one["robot"], one["serial_number"], one["stopped"], one["number"]) == (name, serial, True, 1)

    with_socket(tmp_path, act)


def requests_at(stuck: StopListener) -> list[str]:
    """What is to be read at a master that has not read anything."""
    found: list[str] = []
    while True:
        try:
            connection, _ = stuck.socket.accept()
        except BlockingIOError:
            return found
        with connection:
            found.append(json.loads(connection.recv(4096))["do"])


@needs_sockets
def test_a_go_that_a_master_finds_when_it_goes_on_again_moves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async def act(stage: Stage) -> None:
        assert "have confirmed" in await typed("stop")
        monkeypatch.setattr("msbot.master.stop_socket.monotonic", lambda: time.monotonic() + 0.1)
        latest = time.monotonic() + PATIENCE_S
        while "a GO was not obeyed" not in caplog.text:  # on a busy computer its time is over before it was sent
            assert time.monotonic() < latest
            assert (await asyncio.to_thread(ask_masters, {"do": "go", "who": "ann"}, 0.05))[0] == []
        assert stage.parts["AA"].stopped
        monkeypatch.setattr("msbot.master.stop_socket.monotonic", time.monotonic)
        assert "STOP is over" in await typed("go")

    with_socket(tmp_path, act)


@needs_sockets
@pytest.mark.promise("Every request of who may say STOP is a STOP, and a GO ends none that its sayer did not know of")
def test_a_reason_of_any_length_is_a_stop(tmp_path: Path) -> None:
    async def act(stage: Stage) -> None:
        for reason in ("x" * 100_000, "\N{PILE OF POO}" * 50_000, "\udcff" * 5_000):
            said = await asyncio.to_thread(stop_route.say_stop, stop_route.ChosenRobots(None, None), reason)
            assert len(said.answers) == 1
            assert stage.master.stop.stopped
            stage.master.say_go("ann")

    with_socket(tmp_path, act)


@pytest.mark.skipif(os.name != "posix", reason="files have no owners here")
@pytest.mark.promise("Another user of the computer does not keep STOP away")
def test_a_robot_db_that_others_may_have_put_here_means_no_robot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    beside, elsewhere = tmp_path / "robot.db", tmp_path / "elsewhere.db"
    elsewhere.touch()

    def means_one() -> bool:
        return stop_route.ChosenRobots(None, None).database is not None

    assert not means_one()
    os.mkfifo(beside)
    assert not means_one()
    beside.unlink()
    beside.mkdir()
    assert not means_one()
    beside.rmdir()
    beside.symlink_to("/dev/zero")
    assert not means_one()
    beside.unlink()
    beside.symlink_to(elsewhere)
    assert means_one(), "a link of one's own"
    beside.unlink()
    beside.touch()
    assert means_one()
    monkeypatch.setattr(stop_route, "own_user", lambda: beside.stat().st_uid + 1)
    assert not means_one(), "a file of somebody else"
    assert stop_route.ChosenRobots(None, None).is_all


@needs_sockets
def test_a_group_in_which_nobody_is_stops_nobody(tmp_path: Path) -> None:
    async def act(stage: Stage) -> None:
        async with answering(stage, str(tmp_path / "robot.db")), answering(stage, "other.db", "OTHER"):
            for words in (("stop",), ("stop", "--status"), ("go",)):
                said = await typed(*words, "--stop-group", "nobody")
                assert "no master of the STOP group nobody runs here" in said
        assert not stage.master.stop.stopped
        said = await typed("stop", "--stop-group", own_group())
        assert said.startswith(f"STOP at the one robot of the STOP group {own_group()} that runs on this computer")
        assert "(to end it there: msbot go --robot " in said
        assert said.rstrip().endswith(f"--stop {stage.master.stop.number})"), "a newer one is not ended by it"

    with_socket(tmp_path, act)


@needs_sockets
@pytest.mark.promise("A STOP group that cannot be used keeps no robot running")
@pytest.mark.parametrize("words", [("stop",), ("class", "stop")])
def test_a_variable_that_names_no_group_stops_all_and_says_so(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def act(stage: Stage) -> None:
        stage.master._stop_group = ""  # it has its own environment in life
        monkeypatch.setenv("MSBOT_STOP_GROUP", "bench 1")
        said = await typed(*words)
        assert "$MSBOT_STOP_GROUP: 'bench 1' is no name for a STOP group" in said
        assert "STOP goes to every robot of yours" in said
        assert stage.master.stop.stopped
        assert "NOT delivered: $MSBOT_STOP_GROUP: 'bench 1' is no name" in await typed("go")
        assert stage.master.stop.stopped
        for command_of_stop in ("stop", "go"):
            assert "NOT delivered: 'bench 1' is no name" in await typed(command_of_stop, "--stop-group", "bench 1")
        assert "STOP is over" in await typed("go", "--stop-group", "")

    with_socket(tmp_path, act)


@needs_sockets
def test_go_tells_two_masters_of_one_name_apart(tmp_path: Path) -> None:
    async def act(stage: Stage) -> None:
        own, db = stage.master.profile, str(tmp_path / "robot.db")
        twin = StopSocket(stage.master, lambda: {**master_details(stage.master, db), "serial_number": "TWIN"})
        task = asyncio.create_task(twin.run())
        await asyncio.sleep(0.01)  # it listens
        try:
            said = await typed("go")
            assert "say with --robot or --db which one may go on: " in said
            for number in (own.serial_number, "TWIN"):
                assert f"{own.name} {number}: msbot go --robot {number}" in said
            assert "have confirmed" in await typed("stop", "--robot", "TWIN")
            assert "STOP is over" in await typed("go", "--robot", "TWIN")
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    with_socket(tmp_path, act)


def status(confirmed: int, silent: int, name: str = "p") -> StopStatus:
    return StopStatus(
        True,
        1,
        "ann",
        "",
        1,
        tuple(StopConfirmation(f"{name}{number}", 1.0) for number in range(confirmed)),
        tuple(f"{name}{number}" for number in range(confirmed, confirmed + silent)),
    )


@given(st.integers(0, 30), st.integers(0, 30), st.sampled_from(["p", "ü" * 60]), st.integers(400, 3000))
def test_an_answer_that_is_too_long_counts_what_it_leaves_out(
    confirmed: int, silent: int, name: str, most: int
) -> None:
    whole = answer_of(status(confirmed, silent, name))
    answer = fitting(whole, most)
    assert len(json.dumps(answer)) <= most
    shown = [answer["confirmed"], answer["silent"]]
    assert isinstance(shown[0], list)
    assert isinstance(shown[1], list)
    left_out = answer.get("left_out", 0)
    assert isinstance(left_out, int)
    assert len(shown[0]) + len(shown[1]) + left_out == confirmed + silent
    assert answer["not_confirmed"] == silent
    words = "\n".join(_words(answer))
    assert ("NOT confirmed" in words) is (silent > 0)
    assert ("all " in words or "the one part" in words) is (silent == 0 < confirmed)


@pytest.mark.parametrize(
    ("status", "last"),
    [
        (
            StopStatus(True, 1, is_stored=False),
            "STOP is not stored yet: as long as it is not, it ends with this master",
        ),
        (StopStatus(True, 1, trouble="the disk is full"), "the disk is full; it holds as long as this master runs"),
        (StopStatus(True, 1), "STOP holds; no part is in the robot"),
        (StopStatus(False, 1), "STOP has been ended meanwhile: `msbot go`, or the page"),
    ],
)
def test_what_is_not_stored_and_what_holds_no_more_is_said(status: StopStatus, last: str) -> None:
    assert _words(answer_of(status))[-1] == last
