"""The class view: robots of the database and of other masters, and one STOP that says whom it did not reach."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence

from msbot.stop.stop_request import SilentMaster
from msbot_web.local_masters import LocalMaster, LocalMasters
from msbot_web.models.class_models import RobotTile
from msbot_web.pages.classroom import _for_visitor
from msbot_web.whole_class import with_neighbours

OWN = "/home/ann/robot.db"


def tile(name: str, *, running: bool = False, here: bool = False) -> RobotTile:
    return RobotTile(
        name=name,
        serial_number="1",
        running=running,
        here=here,
        owner="",
        slots=3,
        active=2,
        last_event="",
        last_event_age_s=None,
    )


def master(robot: str, *, stopped: bool = False) -> LocalMaster:
    return LocalMaster(robot, "1", f"http://127.0.0.1:{len(robot)}", 5, 4, stopped, OWN)


def test_a_robot_of_the_database_gets_what_its_master_says() -> None:
    (one,) = with_neighbours(
        [tile("ROVER", running=True, here=True)], [master("ROVER", stopped=True)], "/home/ann/robot.db"
    )
    assert (one.here, one.address, one.slots, one.active, one.stopped, one.reachable) == (
        True,
        "http://127.0.0.1:5",
        5,
        4,
        True,
        True,
    )


def test_a_robot_of_another_database_is_there_too_and_one_elsewhere_is_not_reachable() -> None:
    tiles = {one.name: one for one in with_neighbours([tile("FAR", running=True)], [master("NEAR")], OWN)}
    assert tiles["NEAR"].running
    assert tiles["NEAR"].reachable
    assert not tiles["FAR"].reachable


def test_two_robots_of_the_same_names_are_two_when_their_databases_are() -> None:
    own, other = (
        master("ROVER"),
        LocalMaster("ROVER", "1", "http://127.0.0.1:9", 7, 1, stopped=True, database="/bob.db"),
    )
    for order in ([own, other], [other, own]):
        here, there = with_neighbours([tile("ROVER", running=True, here=True)], order, OWN)
        assert (here.here, here.address, here.slots, here.stopped) == (True, "http://127.0.0.1:5", 5, False)
        assert (there.here, there.address, there.slots, there.stopped) == (False, "http://127.0.0.1:9", 7, True)


def test_one_stop_for_all_says_how_many_it_did_not_reach() -> None:
    asked: list[Mapping[str, object]] = []

    def ask(request: Mapping[str, object]) -> tuple[list[dict[str, object]], Sequence[SilentMaster]]:
        asked.append(request)
        answer = {"stopped": True, "told": 3, "confirmed": [{"part": "AA", "ms": 1.0}], "silent": ["BB", "CC"]}
        return [{"robot": "A", **answer}, {"robot": "B", "error": "no"}, {"robot": "C", **answer}], [
            SilentMaster(None, 0, 0, "/tmp")
        ]

    done = asyncio.run(LocalMasters(ask).stop_all("ann", "enough", "A", OWN))
    assert asked == [{"do": "stop", "who": "ann", "reason": "enough", "page_of": "A", "database": OWN}]
    assert (done.told, done.confirmed, done.parts, done.silent) == (("A", "C"), 2, 6, 2)
    assert done.waiting == ("A (BB, CC)", "C (BB, CC)")


def test_what_a_master_says_of_itself_is_taken_as_far_as_it_makes_sense() -> None:
    def ask(_: Mapping[str, object]) -> tuple[list[dict[str, object]], Sequence[SilentMaster]]:
        return [{"robot": "A", "serial_number": "7", "slots": "3", "active": "x", "stopped": "yes"}], []

    assert asyncio.run(LocalMasters(ask).find()) == [LocalMaster("A", "7", "", 3, 0, stopped=False)]


def test_a_page_for_every_network_is_linked_by_the_name_that_the_visitor_came_by() -> None:
    assert _for_visitor("http://0.0.0.0:8081", "lab-pc") == "http://lab-pc:8081"
    assert _for_visitor("https://[::]:8081", "fe80::1") == "https://[fe80::1]:8081"
    assert _for_visitor("http://127.0.0.1:8081", "lab-pc") == "http://127.0.0.1:8081"
    assert _for_visitor("", "lab-pc") == ""
