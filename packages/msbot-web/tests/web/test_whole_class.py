"""Robots on other computers among the tiles of the class, and in its one STOP."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest
from pydantic import TypeAdapter

from msbot_agent.text.untrusted_input import read_program_json
from msbot_school.classroom.class_robots import ClassRobot, RemoteRobot, database_mark
from msbot_school.classroom.remote_access import RemoteAccess, RemoteAccessFile
from msbot_web import remote_robots
from msbot_web.local_masters import Ask, LocalMasters, StopForAll
from msbot_web.models.class_models import RobotTile
from msbot_web.pages.classroom import _for_visitor, _natural, _state_of
from msbot_web.remote_robots import RemoteRobots, RemoteStop
from msbot_web.whole_class import together, with_far, with_neighbours
from msbot_xrce.errors import ConfigError
from tests.web.refusing import refusing_port

DATABASE = "postgresql://server/robots"
PAGE = "http://10.0.0.2:8080"


def tile(name: str, *, reachable: bool = False) -> RobotTile:
    return RobotTile(
        name=name,
        serial_number="1",
        running=True,
        here=False,
        owner="",
        slots=3,
        active=2,
        last_event="x",
        last_event_age_s=None,
        reachable=reachable,
    )


def far(name: str, database: str = "", trouble: str = "") -> ClassRobot:
    status = {"robot": name, "slots": 5, "active": 4, "stopped": True, "database": database}
    known = RemoteRobot(RemoteAccess(PAGE, "t", name, "1"), {} if trouble else status, trouble)
    return ClassRobot(name, "1", "2", PAGE, None, blueprint="abcd1234", msbot="0.1.0", far=known)


def test_a_robot_of_the_database_that_runs_elsewhere_gets_what_its_master_says() -> None:
    (one,) = with_far([tile("R")], [far("R", database_mark(DATABASE))], DATABASE)
    assert (one.elsewhere, one.reachable, one.stopped, one.slots, one.active) == (True, True, True, 5, 4)
    assert (one.address, one.blueprint, one.msbot, one.last_event) == (PAGE, "abcd1234", "0.1.0", "x")


def test_one_of_the_same_name_in_another_database_is_another_robot() -> None:
    for database in ("", database_mark("sqlite:other")):
        there, elsewhere = with_far([tile("R")], [far("R", database)], DATABASE)
        assert (there.elsewhere, elsewhere.elsewhere) == (False, True)


def test_what_a_master_of_this_computer_says_is_not_covered_by_the_way_over_the_network() -> None:
    (one,) = with_far([tile("R", reachable=True)], [far("R", database_mark(DATABASE))], DATABASE)
    assert not one.elsewhere


def test_of_one_that_does_not_answer_nothing_else_is_said() -> None:
    (one,) = with_far([], [far("R", trouble=f"{PAGE}: no answer in time")], DATABASE)
    assert (one.running, one.reachable, one.stopped) == (False, False, False)
    assert _state_of(one) == ("late", "its master does not answer")


def test_one_stop_counts_only_what_was_said_and_names_the_rest() -> None:
    here = StopForAll(("A",), 2, 3, 0, ("A (x)",), ("A",))
    said = together(
        here,
        [
            RemoteStop("B 1", {"stopped": True, "told": 2, "not_confirmed": 0, "silent": []}),
            RemoteStop("C 1", {"stopped": True, "told": 3, "not_confirmed": 1, "silent": ["arm"], "stored": False}),
            RemoteStop("D 1", {"stopped": True, "told": None, "not_confirmed": 0, "silent": []}),
            RemoteStop("E 1", {"stopped": False, "told": 0, "not_confirmed": 0}),
            RemoteStop("F 1", None, "http://f: no answer in time"),
        ],
    )
    assert said.told == ("A", "B 1", "C 1", "D 1")
    assert (said.confirmed, said.parts) == (2 + 2 + 2, 3 + 2 + 3)
    assert said.waiting == ("A (x)", "C 1 (arm)", "D 1")
    assert said.not_stored == ("A", "C 1")
    assert said.not_told == ("E 1", "F 1: http://f: no answer in time")


def test_a_look_is_shared_and_a_file_that_cannot_be_used_is_told(tmp_path: Path) -> None:
    with refusing_port() as port:
        look_at_one_that_is_away(tmp_path, f"http://127.0.0.1:{port}")


def look_at_one_that_is_away(folder: Path, address: str) -> None:
    book, now = RemoteAccessFile(folder), 0.0
    book.add(RemoteAccess(address, "t", "R", "1"))

    async def scene() -> None:
        nonlocal now
        looking = RemoteRobots(lambda: now, book)
        first = await looking.snapshot()
        assert [one.far and one.far.trouble for one in first] == [f"{address}: Connection refused"]
        assert await looking.snapshot() is first, "a moment later nobody is asked again"
        (stop,) = await looking.stop_all("")
        assert (stop.robot, stop.answer, stop.trouble) == ("R 1", None, f"{address}: Connection refused")
        book.path.write_text("{")
        now += remote_robots.AGAIN_S
        assert await looking.snapshot() is first, "nobody waits for the next look"
        assert looking._looking is not None
        await asyncio.wait([looking._looking])
        with pytest.raises(ConfigError, match="move it away"):
            await looking.snapshot()
        with pytest.raises(ConfigError, match="move it away"):
            await looking.snapshot()

    asyncio.run(scene())


def test_robot_10_comes_after_robot_9() -> None:
    assert sorted(["r10", "R9", "a", "r", "10", "9"], key=_natural) == ["9", "10", "a", "r", "R9", "r10"]


ODD = (
    b"null", b"true", b"-1", b"0", b"1e999", b"1.5", b"9" * 4000, b'"' + b"9" * 5000 + b'"', b'"\\ud800"', b'"\\u0000"',
    b'"\xd9\xa3"', b'"javascript:alert(1)"', b'"http://["', b"[]", b'["\\udfff"]', b"{}", b"[" * 80 + b"]" * 80,
)  # fmt: skip
SAID = (
    "robot",
    "serial_number",
    "page",
    "slots",
    "active",
    "stopped",
    "told",
    "silent",
    "not_confirmed",
    "confirmed",
    "stored",
    "database",
    "version",
    "blueprint",
    "msbot",
    "stop_group",
)


def answering(answer: dict[str, object]) -> Ask:
    return lambda _: ([answer], [])


@pytest.mark.parametrize("odd", ODD)
@pytest.mark.promise("Whatever another master answers, the class is shown and its STOP is told")
async def test_a_master_that_answers_nonsense_breaks_neither_the_class_nor_its_stop(odd: bytes) -> None:
    usual: dict[str, object] = {"robot": "R", "slots": 3, "stopped": True, "told": 2, "not_confirmed": 1}
    for name in SAID:
        answer = read_program_json(json.dumps({**usual, name: "ODD"}).encode().replace(b'"ODD"', odd))
        masters = LocalMasters(answering(answer))
        tiles = with_neighbours([], await masters.find(), DATABASE)
        known = RemoteRobot(RemoteAccess(PAGE, "t", "R", "1"), answer)
        tiles = with_far(tiles, [ClassRobot("R", "1", "2", PAGE, None, far=known)], DATABASE)
        shown = TypeAdapter(list[RobotTile]).dump_json(tiles)
        assert len(json.loads(shown)) == 2
        assert all(_for_visitor(tile.address, "localhost") is not None for tile in tiles)
        assert b"javascript:" not in shown or name != "page"
        whole = together(await masters.stop_all("ada", "test", "A"), [RemoteStop("R 1", answer)])
        assert "R 1" in (*whole.told, *whole.not_told)
        json.dumps(whole.waiting, ensure_ascii=False).encode()


@pytest.mark.parametrize("octets", [b"[" * 900 + b"]" * 900, b"[" * 100_000], ids=["900", "without end"])
def test_an_answer_is_no_deeper_than_can_be_read(octets: bytes) -> None:
    with pytest.raises(ValueError, match=r"nested too deeply|Expecting value"):
        read_program_json(octets)
