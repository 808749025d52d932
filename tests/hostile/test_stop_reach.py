"""One STOP for all robots of a class that reaches robots of others, or that somebody says who may not."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from functools import partial
from pathlib import Path

import pytest

from msbot.master import StopSocket
from msbot.operations.rights import Role
from msbot.pnp import StopStatus
from msbot.stop.socket_folders import IS_THERE
from msbot.stop.socket_names import GROUP_VARIABLE
from msbot.stop.stop_request import SilentMaster, ask_masters
from msbot_agent.process.end_signals import run_to_end
from msbot_web.local_masters import LocalMasters
from msbot_web.models.class_models import RobotTile
from msbot_web.whole_class import is_in_class
from tests.runtime.stop_stage import PATIENCE_S, own_places
from tests.web.rig import Rig, refusal, show

REACH = "STOP for all robots of a class is a teacher's, and reaches no robot of another class"
OWN, OTHER = "/class7b/robot.db", "/home/bob/robot.db"


@pytest.fixture(autouse=True)
def _places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(GROUP_VARIABLE, raising=False)
    own_places(tmp_path, monkeypatch)


class Robot:
    """What a master's socket needs of it."""

    def __init__(self, name: str, database: str, group: str = "") -> None:
        self.name, self.database, self.stop_group = name, database, group
        self.stop = StopStatus()
        self.places: list[str] = []

    def say_stop(self, by: str, _reason: str = "", place: str = "") -> StopStatus:
        self.places.append(f"{by}, {place}")
        self.stop = StopStatus(stopped=True, number=1)
        return self.stop

    async def until_stop_is_stored(self) -> StopStatus:
        return self.stop

    def details(self) -> dict[str, str]:
        known = {"robot": self.name, "serial_number": "1", "database": self.database}
        return {**known, "stop_group": self.stop_group}


def with_sockets(robots: list[Robot], act: Callable[[], Awaitable[None]]) -> None:
    """Each of them takes STOP by a socket of its own."""

    async def main() -> None:
        tasks = [asyncio.create_task(StopSocket(one, one.details).run()) for one in robots]  # type: ignore[arg-type]
        async with asyncio.timeout(PATIENCE_S):
            while len(await asyncio.to_thread(_status)) < len(robots):  # noqa: ASYNC110 - sockets make no sound
                await asyncio.sleep(0.005)
        try:
            await act()
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    run_to_end(main())


def _status() -> list[dict[str, object]]:
    return ask_masters({"do": "status", "who": "test"}, PATIENCE_S, "")[0]


@pytest.mark.skipif(not IS_THERE, reason="this system has no Unix sockets")
@pytest.mark.promise(REACH)
@pytest.mark.parametrize(
    ("group", "reached"), [("", {"R1", "R2", "BENCH"}), ("bench", {"BENCH", "BOB_BENCH"}), ("nobody", set())]
)
def test_the_class_is_a_database_or_a_group_that_both_chose(group: str, reached: set[str]) -> None:
    robots = [
        Robot("R1", OWN), Robot("R2", OWN), Robot("BENCH", OWN, "bench"), Robot("BOB", OTHER),
        Robot("BOB_BENCH", OTHER, "bench"), Robot("NO_DATABASE", ""),
    ]  # fmt: skip

    async def act() -> None:
        masters = LocalMasters.of_group(lambda: group)
        done = await masters.stop_all("ann", "", "R1", None if group else OWN)
        assert set(done.told) == reached
        assert {one.name for one in robots if one.places} == reached
        assert {place for one in robots for place in one.places} <= {"ann, the page of R1"}

    with_sockets(robots, act)


@pytest.mark.promise(REACH)
def test_a_pupil_stops_the_own_robot_and_not_the_class(tmp_path: Path) -> None:
    asked: list[object] = []

    def nobody(request: Mapping[str, object]) -> tuple[list[dict[str, object]], list[SilentMaster]]:
        asked.append(request.get("database"))
        return [], []

    async def scene(rig: Rig) -> None:
        school = rig.service.whole_class
        school._neighbours = LocalMasters(nobody)
        for role in (Role.VIEWER, Role.STUDENT):
            who = rig.session(role)
            assert "may not stop all robots of the class" in str(await refusal(partial(school.stop_all, who)))
        guest = rig.accounts.sessions.begin("guest 1", Role.VIEWER, guest_of="teacher")
        assert "may not" in str(await refusal(lambda: school.stop_all(guest)))
        assert (asked, rig.service.is_stopped) == ([], False)
        await rig.act(rig.session(Role.STUDENT), "stop")
        status = rig.service.operations.stopping.status
        assert (status.by, status.place) == ("student", f"the page of {rig.service.robot_name}")
        await school.stop_all(rig.session(Role.TEACHER))
        assert len(asked) == 1
        assert asked[0] not in (None, ""), "robots of other databases are left alone"

    show(tmp_path, scene)


def test_which_tiles_are_shown_as_of_the_class() -> None:
    def tile(database: str, group: str = "", **more: bool) -> RobotTile:
        made = RobotTile(
            name="R", serial_number="1", running=True, here=False, owner="", slots=1, active=1, last_event="",
            last_event_age_s=None, database=database, stop_group=group, reachable=True,
        )  # fmt: skip
        return made.model_copy(update=more)

    assert is_in_class(tile("a"), "", "a")
    assert not is_in_class(tile("b"), "", "a")
    assert not is_in_class(tile(""), "", ""), "no database is no common one"
    assert is_in_class(tile("b", elsewhere=True), "", "a"), "an access is what both sides agreed on"
    assert not is_in_class(tile("b", elsewhere=True), "bench", "a")
    assert is_in_class(tile("b", elsewhere=True, reachable=False), "bench", "a"), "nobody knows its group: it is named"
    assert is_in_class(tile("b", "bench"), "bench", "a")
    assert not is_in_class(tile("a"), "bench", "a")
