"""Pupils: whose programs are held and which slots are theirs, decided by the inventory."""

from __future__ import annotations

import pytest

from msbot.config import Slot
from msbot.pnp import Claim, Configuration, Freeze, Group, PartState, Pupils, SlotBinding, TakeOverByTeacher
from msbot.pnp.robot_gate import RobotGate
from tests.pnp.robot import Rig, configuration, sample_store

RED, BLUE = Group("Red", ("ada", "ben"), ("BB",)), Group("Blue", ("cleo",), ("DD",))


def rig(*groups: Group) -> Rig:
    """The ring with a second slot for EFGH."""
    store = sample_store(Slot("DD", "EFGH"))
    spare = Configuration(1, "DD", (SlotBinding("out", "spare", "HelloWorld", publishes=True),), ())
    store = type(store)(
        types=tuple(store.types.values()) if hasattr(store, "types") else (),
        slots=tuple(store.slots()),
        configurations=(*(configuration(slot) for slot in ("AA", "BB", "CC")), spare),
    )
    made = Rig(store)
    made.inventory.pupil_parts.pupils.use_groups(groups)
    return made


def test_a_program_gets_a_slot_of_its_group_whoever_comes_first() -> None:
    robot = rig(RED, BLUE)
    for key, pupil in ((1, "cleo"), (2, "ada"), (3, "ben")):
        robot.join(key, pupil=pupil)
        robot.claim(key, "EFGH")
    assert [robot.part(key).slot for key in (1, 2, 3)] == ["DD", "BB", None]
    assert robot.state(3) is PartState.STANDBY
    robot.leave(2)
    assert robot.part(3).slot == "BB"  # of the same group: takes over


def test_a_spare_of_another_group_does_not_take_over() -> None:
    robot = rig(RED, BLUE)
    for key, pupil in ((1, "ada"), (2, "cleo"), (3, "cleo")):
        robot.join(key, pupil=pupil)
        robot.claim(key, "EFGH")
    robot.leave(1)
    assert robot.part(3).slot is None
    match = robot.inventory.slots.match(Claim("EFGH", "BB"), pupil="cleo")
    assert ("group", "free slots of other groups are not for cleo") in match.evidence


def test_who_is_no_pupil_may_have_any_slot_and_without_a_group_only_nobodys() -> None:
    robot = rig(RED)
    robot.claim(1, "EFGH", name="BB")
    assert robot.part(1).slot == "BB"
    robot = rig(RED)
    robot.join(1, pupil="dora")
    robot.claim(1, "EFGH", name="BB")
    assert robot.part(1).slot == "DD"


def test_ones_own_slot_comes_before_everybodys() -> None:
    robot = rig(Group("Red", ("ada",), ("DD",)))
    robot.join(1, pupil="ada")
    robot.claim(1, "EFGH", name="BB")
    assert robot.part(1).slot == "DD"


def test_a_slot_that_another_group_gets_is_left_at_once_and_not_remembered() -> None:
    robot = rig()
    robot.join(1, pupil="cleo")
    robot.claim(1, "EFGH", name="BB")
    assert robot.part(1).slot == "BB"
    robot.inventory.pupil_parts.pupils.use_groups([RED])
    robot.inventory.pupil_parts.regroup(robot.now)
    assert robot.part(1).slot is None
    assert "belongs to group Red" in robot.part(1).reason
    robot.claim(1, "EFGH", name="BB")
    assert robot.part(1).slot == "DD"


def test_who_is_here_and_in_which_slots() -> None:
    robot = rig(RED, BLUE)
    for key, pupil in enumerate(("ada", "cleo", "cleo", "dora", ""), 1):
        robot.join(key, pupil=pupil)
    for key, number in ((1, "EFGH"), (2, "EFGH"), (3, "ABCD"), (5, "WXYZ")):
        robot.claim(key, number)
    here = robot.inventory.pupil_parts.here
    assert here() == {"ada": ("BB",), "cleo": ("DD", "AA"), "dora": ()}
    robot.leave(1)
    robot.inventory.rearrange({2: None}, robot.now, "taken out")
    assert here() == {"cleo": ("AA",), "dora": ()}
    assert robot.part(1).slot == "BB", "a slot that is shown of somebody who has left is not held"


def test_a_slot_that_is_given_to_a_group_is_filled_from_it_at_once() -> None:
    robot = rig()
    for key, pupil in ((1, "cleo"), (2, "dora"), (3, "ada")):
        robot.join(key, pupil=pupil)
        robot.claim(key, "EFGH", name="BB")
    assert [robot.part(key).slot for key in (1, 2, 3)] == ["BB", "DD", None]
    robot.inventory.pupil_parts.pupils.use_groups([RED])
    robot.inventory.pupil_parts.regroup(robot.now)
    assert [robot.part(key).slot for key in (1, 2, 3)] == [None, "DD", "BB"]


def test_of_a_part_that_has_to_begin_anew_nobody_is_told_that_it_is_held() -> None:
    robot = rig()
    robot.join(1, pupil="ada")
    robot.claim(1, "ABCD")
    robot.claim(2, "EFGH", name="BB")
    robot.claim(3, "WXYZ")
    robot.join(1, pupil="ada")
    assert robot.state(1) is PartState.CHECKING
    told: list[tuple[int, str, bool]] = []
    robot.inventory.on_partner(lambda *news: told.append(news))
    robot.rights.clear()
    robot.inventory.pupil_parts.pupils.freeze = Freeze("novak", "", robot.now)
    robot.inventory.pupil_parts.follow(robot.now)
    assert robot.inventory.pupil_parts.is_held(1)
    assert (told, robot.rights) == ([], [])


class Asker:
    """A client as the gate sees it."""

    def __init__(self, key: int) -> None:
        self.key = self.client_key = key
        self.patience_s, self.link, self.peer, self.address = 0.0, "ws:", None, ""


def test_a_held_part_keeps_its_slot_and_uses_no_topic() -> None:
    robot = rig()
    told: list[tuple[int, str, bool]] = []
    robot.inventory.on_partner(lambda *news: told.append(news))
    access = RobotGate(robot.inventory, clock=lambda: robot.now, free_topics=frozenset({"chat"}))
    robot.join(1, pupil="ada")
    robot.claim(1, "ABCD")
    robot.claim(2, "EFGH", name="BB")
    robot.run(0.1)
    one, two = Asker(1), Asker(2)
    topics = ("HelloWorldTopic_1_to_2", "chat")
    assert [access.may_write(one, topic) for topic in topics] == [True, True]
    told.clear()
    robot.rights.clear()
    robot.inventory.pupil_parts.pupils.freeze = Freeze("novak", "", robot.now)
    robot.inventory.pupil_parts.follow(robot.now)
    assert robot.state(1) is PartState.ACTIVE
    assert [access.may_write(one, topic) for topic in topics] == [False, False]
    assert not access.may_read(one, "HelloWorldTopic_3_to_1")
    assert access.may_write(one, "msbot_inventory_Request")  # it beats, and confirms STOP
    assert access.may_write(two, "HelloWorldTopic_2_to_3")
    assert 1 in robot.rights
    assert (2, "HelloWorldTopic_1_to_2", False) in told  # whoever listens goes to its safe value
    assert (1, "HelloWorldTopic_3_to_1", False) in told  # and so does the part itself
    told.clear()
    robot.inventory.pupil_parts.pupils.freeze = None
    robot.inventory.pupil_parts.follow(robot.now)
    assert access.may_write(one, "HelloWorldTopic_1_to_2")
    assert told == [(2, "HelloWorldTopic_1_to_2", True)]  # nobody publishes what the part itself reads


def test_who_joins_during_a_freeze_is_held_from_the_start() -> None:
    robot = rig()
    robot.inventory.pupil_parts.pupils.freeze = Freeze("novak", "", robot.now)
    told: list[tuple[int, str, bool]] = []
    robot.claim(2, "EFGH", name="BB")
    robot.inventory.on_partner(lambda *news: told.append(news))
    robot.join(1, pupil="ada")
    robot.claim(1, "ABCD")
    assert robot.state(1) is PartState.ACTIVE
    assert robot.inventory.pupil_parts.is_held(1)
    assert not [news for news in told if news[2]]  # no partner comes with it


@pytest.mark.parametrize(
    ("freeze", "taken", "words"),
    [
        (None, None, ""),
        (Freeze("novak", "look", 0.0), None, "the class is frozen by novak: look"),
        (None, TakeOverByTeacher("novak", 0.0), "novak has taken over the program of ada"),
        (Freeze("novak", "", 0.0), TakeOverByTeacher("novak", 0.0, runs=True), ""),
    ],
)
def test_why_a_program_is_held(freeze: Freeze | None, taken: TakeOverByTeacher | None, words: str) -> None:
    pupils = Pupils()
    pupils.freeze = freeze
    if taken is not None:
        pupils.taken["ada"] = taken
    assert pupils.held("ada") == words
    assert pupils.held("") == ""


def test_why_a_pupil_may_not_do_anything_with_a_slot_and_which_groups_there_are() -> None:
    pupils = Pupils()
    pupils.use_groups([RED, BLUE])
    assert pupils.groups == (BLUE, RED)
    people, slots = ("", "ada", "cleo", "dora"), ("AA", "BB", "DD")

    def answers() -> list[list[str]]:
        return [[pupils.why_not(pupil, slot) for slot in slots] for pupil in people]

    red, blue = "slot BB belongs to group Red", "slot DD belongs to group Blue"
    assert answers() == [["", "", ""], ["", "", blue], ["", red, ""], ["", red, blue]]
    pupils.freeze = Freeze("novak", "", 0.0)
    held = "the class is frozen by novak"
    assert answers() == [["", "", ""], [held, held, blue], [held, red, held], [held, red, blue]]


def test_who_is_let_go_hears_again_of_what_others_say() -> None:
    robot = rig()
    told: list[tuple[int, str, bool]] = []
    robot.join(1, pupil="ada")
    for key, number, slot in ((1, "ABCD", "AA"), (2, "EFGH", "BB"), (3, "WXYZ", "CC")):
        robot.claim(key, number, name=slot)
    robot.inventory.on_partner(lambda *news: told.append(news))
    for freeze in (Freeze("novak", "", robot.now), None):
        told.clear()
        robot.inventory.pupil_parts.pupils.freeze = freeze
        robot.inventory.pupil_parts.follow(robot.now)
        is_there = freeze is None
        assert sorted(told) == [(1, "HelloWorldTopic_3_to_1", is_there), (2, "HelloWorldTopic_1_to_2", is_there)]


def test_nobody_gets_a_slot_of_another_group_by_a_uid_that_somebody_put_there() -> None:
    robot = rig(RED, BLUE)
    robot.join(1, pupil="cleo")
    robot.store.placed[(7).to_bytes(8, "big")] = "BB"
    claim = Claim("EFGH", "BB", (7).to_bytes(8, "big"))
    match = robot.inventory.slots.match(claim, pupil="cleo")
    assert match.slot == Slot("DD", "EFGH")
    assert ("put there by a person", "slot BB belongs to group Red") in match.evidence
    for pupil in ("ada", ""):
        assert robot.inventory.slots.match(claim, pupil=pupil).slot == Slot("BB", "EFGH")


@pytest.mark.parametrize(("pupil", "slot"), [("cleo", None), ("ada", "BB"), ("", "BB")])
def test_nor_as_the_newcomer_for_whom_a_teacher_has_opened_the_window(pupil: str, slot: str | None) -> None:
    robot = rig(RED, BLUE)
    robot.inventory.set_adopter(lambda *_: "BB")
    robot.join(1, pupil=pupil)
    robot.claim(1, "ABCX")
    assert robot.part(1).slot == slot
