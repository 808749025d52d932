"""One blueprint for many from the page: who may, which robots, that it goes on by itself, and the way back."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from dataclasses import replace
from pathlib import Path
from threading import Event

import pytest

from msbot.config import SAMPLE_ROBOT_TOML, Blueprint, load_library, parse_blueprint
from msbot.operations.rights import Role
from msbot.registry import open_registry
from msbot.registry.records import database_identity
from msbot_school.classroom.class_robots import DatabaseReader, database_mark, directly
from msbot_school.classroom.remote_access import RemoteAccess, RemoteAccessFile
from msbot_school.classroom.rollout import RollOut
from msbot_school.classroom.rollout_run import RobotChange, RobotJob, RolledOutChange, RollOutLog, StepState
from msbot_web.access.accounts import Accounts, NotAllowed
from msbot_web.access.users import MemoryUsers
from msbot_web.class_rollouts import ClassRollOuts
from msbot_web.stored_data import no_stored_data
from msbot_xrce.errors import ConfigError
from tests.operations.stage import put_database
from tests.web.access.test_accounts import PlainHasher, user
from tests.web.refusing import refusing_port

EXTRA = SAMPLE_ROBOT_TOML + '\n[[slot]]\nname = "extra"\npart = "RELAY-1"\n'
NAME = "MSBOT_MASTER"


class Room:
    """A database with the robots X1 and X2, neither of which runs, and an access to X9, which is away."""

    def __init__(self, folder: Path, away: str, read: DatabaseReader | None = directly) -> None:
        self.folder = folder
        self.away = away
        self.address = str(folder / "robot.db")
        self.library = load_library()
        put_database(folder / "robot.db")
        serial = next(line for line in SAMPLE_ROBOT_TOML.splitlines() if line.startswith("serial_number"))
        with open_registry(self.address) as registry:
            for number in (1, 2):
                text = SAMPLE_ROBOT_TOML.replace(serial, f'serial_number = "X{number}"')
                registry.robots.apply_blueprint(parse_blueprint(text, self.library), self.library)
        accesses = RemoteAccessFile(folder)
        accesses.add(RemoteAccess(self.away, "msbot_x", NAME, "X9"))
        self.book = RollOutLog(folder)
        users = MemoryUsers(*(user(role.word, role) for role in Role))
        self.accounts = Accounts(users, clock=time.monotonic, hasher=PlainHasher())
        identity = database_identity(self.address)
        self.mark = database_mark(identity)

        async def parse(toml: str) -> Blueprint:
            return parse_blueprint(toml, self.library)

        records = replace(
            no_stored_data(lambda: pytest.fail("not asked")), parse=parse, database=identity, address=self.address
        )
        self.doing = ClassRollOuts(
            records,
            self.accounts,
            lambda: self.library,
            time.monotonic,
            accesses=accesses,
            book=self.book,
            read=read,
        )
        self.admin, self.teacher, self.student = (
            self.accounts.sessions.begin(role.word, role) for role in (Role.ADMINISTRATOR, Role.TEACHER, Role.STUDENT)
        )
        self.ours = [(NAME, "X1", self.mark), (NAME, "X2", self.mark)]
        self.far = (NAME, "X9", "")

    def extra(self) -> list[bool]:
        with open_registry(self.address, read_only=True) as registry:
            return ["extra" in registry.robots.slot_names(record) for record in registry.robots.all()]

    async def over(self) -> list[StepState]:
        run = self.doing.run
        assert run is not None
        await until(lambda: run.is_over)
        return [step.state for step in run.steps]


async def until(condition: Callable[[], bool]) -> None:
    """Wait for what threads do."""
    async with asyncio.timeout(20):
        while True:
            if condition():
                return
            await asyncio.sleep(0.01)


@pytest.fixture
def play(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[Room], Awaitable[None]]], None]:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))  # no master of this user is seen

    def run(scene: Callable[[Room], Awaitable[None]]) -> None:
        async def whole() -> None:
            await scene(Room(tmp_path, f"http://127.0.0.1:{port}"))

        with refusing_port() as port:
            asyncio.run(whole())

    return run


Play = Callable[[Callable[[Room], Awaitable[None]]], None]


def test_a_teacher_rolls_out_to_the_robots_of_the_database_and_takes_it_back(play: Play) -> None:
    async def scene(room: Room) -> None:
        doing, teacher = room.doing, room.teacher
        pattern = await doing.pattern(teacher, "more.toml", EXTRA)
        plans = await doing.plan(teacher, pattern, [*room.ours, room.far])
        assert [plan.changes for plan in plans[:2]] == [("+ slot extra: part RELAY-1",)] * 2
        assert "only an administrator" in plans[2].obstacle
        await doing.begin(teacher, pattern, plans)
        assert await room.over() == [StepState.CHANGED] * 2
        assert room.extra() == [True, True]
        with pytest.raises(ConfigError, match="nothing to change"):
            await doing.begin(teacher, pattern, await doing.plan(teacher, pattern, room.ours))
        last = await doing.last(teacher)
        assert last is not None
        assert (last.blueprint, len(last.done)) == ("more.toml", 2)
        await doing.undo(teacher, last)
        assert await room.over() == [StepState.CHANGED] * 2
        assert room.extra() == [False, False]
        assert room.book.last() is None
        assert not list(room.folder.glob("msbot-rollout-*"))

    play(scene)


def test_the_blueprint_of_one_robot_is_given_to_the_others(play: Play) -> None:
    async def scene(room: Room) -> None:
        doing, teacher = room.doing, room.teacher
        more = await doing.pattern(teacher, "more.toml", EXTRA)
        await doing.begin(teacher, more, await doing.plan(teacher, more, room.ours[:1]))
        await room.over()
        pattern = await doing.pattern_of(teacher, room.ours[0])
        plans = await doing.plan(teacher, pattern, room.ours)
        assert [plan.robot.serial_number for plan in plans] == ["X2"], "not to itself"
        await doing.begin(teacher, pattern, plans)
        await room.over()
        assert room.extra() == [True, True]

    play(scene)


def test_another_process_opens_the_database(play: Play) -> None:
    async def scene(here: Room) -> None:
        room = Room(here.folder, here.away, read=None)
        pattern = await room.doing.pattern(room.teacher, "more.toml", EXTRA)
        try:
            await room.doing.begin(room.teacher, pattern, await room.doing.plan(room.teacher, pattern, room.ours))
            assert await room.over() == [StepState.CHANGED] * 2
        finally:
            room.doing.close()
        assert room.extra() == [True, True]

    play(scene)


def test_rights_hold_whatever_the_page_shows(play: Play) -> None:
    async def scene(room: Room) -> None:
        doing = room.doing
        pattern = await doing.pattern(room.admin, "more.toml", EXTRA)
        plans = await doing.plan(room.admin, pattern, [*room.ours, room.far])
        assert plans[2].obstacle == f"{room.away}: Connection refused"
        forged = [*plans[:2], replace(plans[2], wanted=pattern.blueprint, changes=("x",), obstacle="")]
        for deed in (
            lambda: doing.pattern(room.student, "", EXTRA),
            lambda: doing.plan(room.student, pattern, room.ours),
            lambda: doing.begin(room.student, pattern, plans),
            lambda: doing.last(room.student),
            lambda: doing.begin(room.teacher, pattern, forged),
            lambda: doing.pattern_of(room.teacher, room.far),
        ):
            with pytest.raises(NotAllowed):
                await deed()
        assert room.extra() == [False, False], "nothing, rather than a part of it"
        at = room.book.begin("more.toml")
        room.book.note(at, RolledOutChange(NAME, "X9", room.away, 3))
        last = await doing.last(room.teacher)
        assert last is not None
        with pytest.raises(NotAllowed):
            await doing.undo(room.teacher, last)
        await doing.undo(room.admin, last)
        assert await room.over() == [StepState.SILENT]
        assert room.book.last() == last, "not taken back as far as is known"
        await doing.begin(room.admin, pattern, forged)
        assert await room.over() == [StepState.CHANGED, StepState.CHANGED, StepState.SILENT]
        with pytest.raises(ConfigError, match="not in the class any more: GONE 1"):
            await doing.plan(room.admin, pattern, [("GONE", "1", "")])

    play(scene)


def test_stop_for_all_leaves_those_that_wait_as_they_are_and_one_roll_out_goes_on_at_a_time(
    play: Play, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = Event()

    def slow(self: RollOut, plan: object) -> RobotJob:
        def do() -> RobotChange:
            free.wait(20)
            return RobotChange("done", None)

        return RobotJob("R", do)

    monkeypatch.setattr(RollOut, "job", slow)

    async def scene(room: Room) -> None:
        doing, teacher = room.doing, room.teacher
        pattern = await doing.pattern(teacher, "more.toml", EXTRA)
        plans = await doing.plan(teacher, pattern, room.ours)
        run = await doing.begin(teacher, pattern, plans * 5)
        await until(lambda: sum(step.state is StepState.WORKING for step in run.steps) == 4)
        assert sum(step.state is StepState.WAITING for step in run.steps) == 6, "so many at a time"
        with pytest.raises(ConfigError, match="wait until it is over"):
            await doing.begin(teacher, pattern, plans)
        assert await doing.last(teacher) is None, "looking waits for no robot"
        doing.hold_back("STOP was said to all robots")
        free.set()
        states = await room.over()
        assert states == [StepState.CHANGED] * 4 + [StepState.LEFT] * 6

    play(scene)
