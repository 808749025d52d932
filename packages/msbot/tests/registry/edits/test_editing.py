"""What people change: it holds at once, is recorded, and can be undone."""

import sqlite3
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from sqlalchemy import event

from msbot.config import Library, Scalar, Slot, SlotPort
from msbot.pnp import Claim
from msbot.registry import EditRecord, Registry, RobotRecord, RobotStore
from msbot.registry.edits import wires
from msbot_xrce.errors import ConfigError, RegistryError
from tests.registry.blueprint.test_blueprint_store import LIBRARY, ROBOT, WIRE
from tests.registry.hand import Hand

FIRST, SECOND = b"first UI", b"secondUI"


@pytest.fixture
def robot(registry: Registry) -> RobotRecord:
    return registry.robots.apply_blueprint(ROBOT, LIBRARY)


@pytest.fixture
def store(registry: Registry, robot: RobotRecord) -> RobotStore:
    store = registry.runs.begin(robot)
    store.remember(FIRST, "left", Claim("EYE", "one", FIRST))
    store.remember(SECOND, "right", Claim("EYE", "", SECOND))
    return store


def _period(registry: Registry, robot: RobotRecord, slot: str = "left") -> tuple[Scalar, str, str]:
    (record,) = [record for record in registry.robots.values(robot, slot) if record.name == "period_s"]
    return record.value, record.origin, record.who


def _refused(function: object, *arguments: object, **named: object) -> str:
    assert callable(function)
    with pytest.raises(ConfigError) as caught:
        function(*arguments, **named)
    return str(caught.value)


# Values


def test_a_value_says_what_it_is_and_where_it_comes_from(registry: Registry, robot: RobotRecord) -> None:
    period, invert = registry.robots.values(robot, "left")
    assert (period.name, period.kind, period.unit, period.least, period.most) == ("period_s", "float", "s", 0.01, 60)
    assert (period.default, period.value, period.origin, period.description) == (0.5, 1, "blueprint", "how often")
    assert (invert.name, invert.value, invert.origin, invert.who) == ("invert", False, "library", "")
    assert registry.robots.values(robot, "leg") == ()


def test_a_value_set_by_hand_holds_is_recorded_and_undone(registry: Registry, robot: RobotRecord) -> None:
    store = registry.runs.begin(robot)
    edit = Hand(registry).set_value(robot, "left", "period_s", 2.5, "Ann")
    assert (edit.kind, edit.who, edit.slot, edit.slots, edit.undone) == ("value", "Ann", "left", ("left",), False)
    assert edit.words == "period_s of left: 1 s -> 2.5 s"
    assert _period(registry, robot) == (2.5, "hand", "Ann")
    assert store.configuration("left").version == 2
    assert dict(store.configuration("left").settings)["period_s"] == "2.5"
    undone = Hand(registry).undo(robot, None, "Bob")
    assert (undone.kind, undone.words) == ("undo", "change 1 undone: period_s of left: 1 s -> 2.5 s")
    assert _period(registry, robot) == (1, "blueprint", "")
    assert store.configuration("left").version == 3
    assert [(edit.id, edit.who, edit.undone) for edit in registry.edits.latest(robot)] == [
        (2, "Bob", False),
        (1, "Ann", True),
    ]


def test_a_value_set_by_hand_survives_the_next_start(registry: Registry, robot: RobotRecord) -> None:
    Hand(registry).set_value(robot, "left", "invert", True, "Ann")
    registry.robots.apply_blueprint(ROBOT, LIBRARY)
    (_, invert) = registry.robots.values(robot, "left")
    assert (invert.value, invert.origin) == (True, "hand")
    assert (
        Hand(registry).set_value(robot, "left", "invert", None, "Ann").words
        == "invert of left: true -> false (the library's)"
    )
    assert registry.robots.values(robot, "left")[1].origin == "library"


@pytest.mark.parametrize(
    ("slot", "name", "value", "sentence"),
    [
        ("nose", "period_s", 1, "there is no slot 'nose'; there are left, right, leg"),
        ("left", "colour", 1, "slot left has no parameter 'colour'; there are period_s, invert"),
        ("leg", "period_s", 1, "slot leg has no parameter 'period_s'; there are none"),
        ("left", "period_s", 90, "period_s of slot left: is 90; it must be 0.01 to 60 s"),
        ("left", "invert", 1, "invert of slot left: must be true or false, for example 'false'; it is the number 1"),
        ("left", "period_s", None, "period_s of slot left is not set by hand: its value is the blueprint's already"),
    ],
)
def test_a_value_that_cannot_be_set(
    registry: Registry, robot: RobotRecord, slot: str, name: str, value: Scalar | None, sentence: str
) -> None:
    assert _refused(Hand(registry).set_value, robot, slot, name, value, "Ann") == sentence
    assert registry.edits.latest(robot) == []


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [("period_s", " 2 ", 2), ("period_s", "0.25", 0.25), ("invert", "Yes", True), ("invert", "off", False)],
)
def test_what_a_person_writes_is_read(
    registry: Registry, robot: RobotRecord, name: str, text: str, value: Scalar
) -> None:
    (record,) = [record for record in registry.robots.values(robot, "left") if record.name == name]
    assert record.read(text) == value


@pytest.mark.parametrize(
    ("name", "text"), [("period_s", "soon"), ("period_s", "nan"), ("period_s", "0"), ("invert", "2")]
)
def test_what_is_no_value_is_told(registry: Registry, robot: RobotRecord, name: str, text: str) -> None:
    (record,) = [record for record in registry.robots.values(robot, "left") if record.name == name]
    assert _refused(record.read, text).startswith(f"{name}: ")


# Places


def test_a_part_is_given_a_slot_and_whoever_was_there_is_not_any_more(
    registry: Registry, robot: RobotRecord, store: RobotStore
) -> None:
    edit = Hand(registry).place(robot, SECOND, "left", "Ann")
    assert edit.placed == ((FIRST, None), (SECOND, "left"))
    assert edit.words == f"EYE {SECOND.hex()} belongs in slot left"
    assert [store.remembered_slot(uid) for uid in (FIRST, SECOND)] == [None, "left"]
    assert [store.placed_slot(uid) for uid in (FIRST, SECOND)] == [None, "left"]
    undone = Hand(registry).undo(robot, edit.id, "Ann")
    assert undone.placed == ((FIRST, "left"), (SECOND, "right"))
    assert [store.remembered_slot(uid) for uid in (FIRST, SECOND)] == ["left", "right"]
    assert store.placed_slot(SECOND) is None


def test_a_part_that_was_given_a_slot_keeps_it_when_another_one_is_given_to_somebody_else(
    registry: Registry, robot: RobotRecord, store: RobotStore
) -> None:
    Hand(registry).place(robot, FIRST, "right", "Ann")
    edit = Hand(registry).place(robot, SECOND, "left", "Ann")
    assert edit.placed == ((SECOND, "left"),)
    assert [store.placed_slot(uid) for uid in (FIRST, SECOND)] == ["right", "left"]
    assert [store.remembered_slot(uid) for uid in (FIRST, SECOND)] == ["right", "left"]


def test_a_part_is_released(registry: Registry, robot: RobotRecord, store: RobotStore) -> None:
    assert Hand(registry).place(robot, FIRST, None, "Ann").words == "one belongs in no slot"
    assert store.remembered_slot(FIRST) is None


def test_two_parts_change_places(registry: Registry, robot: RobotRecord, store: RobotStore) -> None:
    edit = Hand(registry).place_swap(robot, SECOND, "left", "Ann", other=FIRST)
    assert edit.words == f"EYE {SECOND.hex()} is swapped into slot left in place of one"
    assert [store.remembered_slot(uid) for uid in (FIRST, SECOND)] == ["right", "left"]
    Hand(registry).undo(robot, None, "Ann")
    assert [store.remembered_slot(uid) for uid in (FIRST, SECOND)] == ["left", "right"]


def test_a_place_outlasts_the_run(registry: Registry, robot: RobotRecord, store: RobotStore) -> None:
    Hand(registry).place(robot, SECOND, "left", "Ann")
    again = registry.runs.begin(robot)
    assert (again.remembered_slot(SECOND), again.placed_slot(SECOND)) == ("left", "left")


def test_what_was_before_can_be_told(registry: Registry, robot: RobotRecord, store: RobotStore) -> None:
    """A spare has taken over meanwhile: the memory has it in the slot already when the edit is recorded."""
    store.remember(SECOND, "left", Claim("EYE", "", SECOND))
    words = "the spare takes over"
    edit = Hand(registry).place(robot, SECOND, "left", "msbot", words=words, by_hand=False, before={SECOND: None})
    assert (edit.words, store.placed_slot(SECOND)) == (words, None)
    Hand(registry).undo(robot, None, "Ann")
    assert [store.remembered_slot(uid) for uid in (FIRST, SECOND)] == ["left", None]


def test_a_part_that_cannot_be_placed(registry: Registry, robot: RobotRecord, store: RobotStore) -> None:
    stranger = b"stranger"
    assert _refused(Hand(registry).place, robot, stranger, "left", "Ann") == (
        f"no part with UID {stranger.hex()} was ever seen here: plug it in first"
    )
    assert "a part without a UID" in _refused(Hand(registry).place, robot, b"", "left", "Ann")
    assert "there is no slot 'nose'" in _refused(Hand(registry).place, robot, FIRST, "nose", "Ann")
    assert registry.edits.latest(robot) == []


# Blocks


def test_a_block_is_recorded_and_undone(registry: Registry, robot: RobotRecord, store: RobotStore) -> None:
    edit = Hand(registry).block(robot, "number", "EYE", "broken series", "Ann")
    assert edit.words == "part number EYE is blocked: broken series"
    assert store.blocked(FIRST, "EYE") == "broken series"
    Hand(registry).undo(robot, None, "Ann")
    assert store.blocked(FIRST, "EYE") is None
    assert _refused(Hand(registry).unblock, robot, "uid", FIRST.hex(), "Ann") == (
        f"part with UID {FIRST.hex()} is not blocked"
    )


def test_whoever_is_let_in_again_can_be_shut_out_again(
    registry: Registry, robot: RobotRecord, store: RobotStore
) -> None:
    Hand(registry).block(robot, "uid", FIRST.hex(), "", "Ann")
    assert store.blocked(FIRST, "EYE") == "no reason given"
    Hand(registry).unblock(robot, "uid", FIRST.hex(), "Ann")
    Hand(registry).undo(robot, None, "Ann")
    assert store.blocked(FIRST, "EYE") == "no reason given"


# Wires


def _topics(store: RobotStore, slot: str) -> list[tuple[str, str]]:
    return [(binding.port, binding.topic) for binding in store.configuration(slot).bindings]


def test_a_wire_is_made_survives_the_next_start_and_is_undone(
    registry: Registry, robot: RobotRecord, store: RobotStore
) -> None:
    edit = Hand(registry).bind(
        robot, "brightness", "Ann", type_name="Light", source=None, targets=[SlotPort("right", "lamp")]
    )
    assert (edit.words, edit.slots) == ("topic brightness joins right.lamp", ("right",))
    assert _topics(store, "right") == [("lamp", "brightness")]
    assert [store.configuration(slot).version for slot in ("left", "right", "leg")] == [1, 2, 1]
    registry.robots.apply_blueprint(ROBOT, LIBRARY)
    assert _topics(store, "right") == [("lamp", "brightness")]
    Hand(registry).undo(robot, None, "Ann")
    assert _topics(store, "right") == []
    assert store.configuration("right").version == 3


def test_a_wire_of_the_blueprint_is_taken_away_and_stays_away(
    registry: Registry, robot: RobotRecord, store: RobotStore
) -> None:
    edit = Hand(registry).unbind(robot, "brightness", SlotPort("leg", "goal"), "Ann")
    assert (edit.words, edit.slots) == ("leg.goal is taken off topic brightness", ("leg",))
    assert (_topics(store, "left"), _topics(store, "leg")) == ([("light", "brightness")], [])
    versions = [store.configuration(slot).version for slot in ("left", "leg")]
    registry.robots.apply_blueprint(ROBOT, LIBRARY)
    assert _topics(store, "leg") == []
    assert [store.configuration(slot).version for slot in ("left", "leg")] == versions
    assert [edit.kind for edit in registry.edits.latest(robot)] == ["bind"]
    Hand(registry).undo(robot, edit.id, "Ann")
    assert _topics(store, "leg") == [("goal", "brightness")]


def test_a_whole_topic_is_taken_away_and_made_anew(registry: Registry, robot: RobotRecord, store: RobotStore) -> None:
    assert Hand(registry).unbind(robot, "brightness", None, "Ann").slots == ("left", "leg")
    edit = Hand(registry).bind(
        robot,
        "other",
        "Ann",
        type_name="Light",
        source=SlotPort("left", "light"),
        targets=[SlotPort("leg", "goal")],
        reliable=False,
    )
    assert edit.slots == ("left", "leg")
    assert [binding.reliable for binding in store.configuration("leg").bindings] == [False]


def test_a_wire_is_moved_and_who_publishes_there_stays(
    registry: Registry, robot: RobotRecord, store: RobotStore
) -> None:
    making = partial(
        wires.bind,
        topic="other",
        type_name="Light",
        source=SlotPort("right", "light"),
        targets=[SlotPort("leg", "goal")],
        move=True,
    )
    edit = registry.edits.make(robot, "Ann", making)
    assert sorted(edit.slots) == ["leg", "right"]
    assert _topics(store, "leg") == [("goal", "other")]
    assert _topics(store, "left") == [("light", "brightness")]
    assert _topics(store, "right") == [("light", "other")]
    registry.robots.apply_blueprint(ROBOT, LIBRARY)
    assert _topics(store, "leg") == [("goal", "other")]  # what the blueprint asks for does not come back beside it
    Hand(registry).undo(robot, None, "Ann")
    assert _topics(store, "leg") == [("goal", "brightness")]
    assert _topics(store, "right") == []


def test_a_moved_wire_is_moved_back_whatever_became_of_other_topics_meanwhile(
    registry: Registry, robot: RobotRecord, store: RobotStore
) -> None:
    Hand(registry).bind(robot, "glow", "Ann", type_name="Light", source=None, targets=[SlotPort("right", "lamp")])
    moving = partial(
        wires.bind, topic="other", type_name="Light", source=None, targets=[SlotPort("leg", "goal")], move=True
    )
    edit = registry.edits.make(robot, "Ann", moving)
    Hand(registry).unbind(robot, "glow", None, "Bob")
    assert _topics(store, "leg") == [("goal", "other")]
    Hand(registry).undo(robot, edit.id, "Ann")
    assert (_topics(store, "leg"), _topics(store, "right")) == ([("goal", "brightness")], [])


def test_the_blueprint_wins_where_a_wire_made_by_hand_contradicts_it(
    registry: Registry, robot: RobotRecord, store: RobotStore
) -> None:
    Hand(registry).bind(robot, "glow", "Ann", type_name="Light", source=None, targets=[SlotPort("left", "lamp")])
    other = replace(WIRE, topic="glow", source=SlotPort("right", "light"), targets=(SlotPort("left", "lamp"),))
    registry.robots.apply_blueprint(replace(ROBOT, bindings=(WIRE, replace(other, reliable=False))), LIBRARY)
    assert [binding.reliable for binding in store.configuration("left").bindings] == [True, False]
    without_left = replace(ROBOT, slots=ROBOT.slots[1:], bindings=())
    registry.robots.apply_blueprint(without_left, LIBRARY)
    registry.robots.apply_blueprint(ROBOT, LIBRARY)
    assert _topics(store, "left") == [("light", "brightness")]


@pytest.mark.parametrize(
    ("topic", "type_name", "source", "target", "sentence"),
    [
        ("x", "Light", None, "leg.wheel", 'has no port "wheel"'),
        ("x", "Light", None, "nose.lamp", "there is no slot 'nose'"),
        ("x", "Heat", None, "left.lamp", 'carries messages of type "Light", the binding says "Heat"'),
        ("x", "Light", "left.lamp", None, "this port can only subscribe"),
        ("x", "Light", None, "leg.goal", '"leg.goal" is bound to "brightness" already'),
        (
            "brightness",
            "Heat",
            None,
            "left.lamp",
            'topic "brightness" carries "Heat" and "Light": a topic has one type',
        ),
        ("msbot_masterTopic", "Light", None, "left.lamp", "belongs to plug-and-play itself"),
        ("x", "Light", None, None, "name a port that publishes it or one that subscribes, as SLOT.port"),
    ],
)
def test_a_wire_that_cannot_be(
    registry: Registry,
    robot: RobotRecord,
    topic: str,
    type_name: str,
    source: str | None,
    target: str | None,
    sentence: str,
) -> None:
    before = registry.runs.begin(robot).configuration("leg")
    words = _refused(
        Hand(registry).bind,
        robot,
        topic,
        "Ann",
        type_name=type_name,
        source=None if source is None else SlotPort(*source.split(".")),
        targets=[] if target is None else [SlotPort(*target.split("."))],
    )
    assert sentence in words
    assert registry.runs.begin(robot).configuration("leg") == before
    assert registry.edits.latest(robot) == []


def test_a_wire_that_is_not_there(registry: Registry, robot: RobotRecord) -> None:
    assert _refused(Hand(registry).unbind, robot, "heat", None, "Ann") == (
        "no port is bound to topic 'heat'; there are brightness"
    )
    assert _refused(Hand(registry).unbind, robot, "brightness", SlotPort("right", "light"), "Ann") == (
        "right.light is not bound to topic 'brightness'; left.light, leg.goal are"
    )


# Blueprints


def test_an_applied_blueprint_is_undone(registry: Registry, robot: RobotRecord, store: RobotStore) -> None:
    Hand(registry).set_value(robot, "right", "period_s", 9, "Ann")
    registry.storage.flush()
    before = [store.configuration(name) for name in ("left", "right", "leg")]
    changed = replace(ROBOT, slots=(replace(ROBOT.slots[0], settings={"period_s": 3}), Slot("arm", "LEG")), bindings=())
    registry.robots.apply_blueprint(changed, LIBRARY, "Bob")
    edit = registry.edits.latest(robot)[0]
    assert (edit.kind, edit.who) == ("apply", "Bob")
    assert edit.words == "the blueprint of R2 is applied: new: arm; gone: right, leg; changed: left"
    assert [slot.name for slot in store.slots()] == ["left", "arm"]
    Hand(registry).undo(robot, None, "Ann")
    assert [slot.name for slot in store.slots()] == ["left", "right", "leg"]
    after = [store.configuration(name) for name in ("left", "right", "leg")]
    assert [replace(one, version=0) for one in after] == [replace(one, version=0) for one in before]
    assert all(new.version > old.version for old, new in zip(before[:1], after[:1], strict=True))
    Hand(registry).undo(robot, edit.id + 1, "Ann")
    assert [slot.name for slot in store.slots()] == ["left", "arm"]


def test_a_blueprint_with_another_description_of_the_robot_alone_says_so(
    registry: Registry, robot: RobotRecord
) -> None:
    registry.robots.apply_blueprint(replace(ROBOT, robot=replace(ROBOT.robot, released="yesterday")), LIBRARY, "Bob")
    (edit,) = registry.edits.latest(robot)
    assert edit.words.endswith("profile, timing, options or descriptions")


def test_applying_the_same_is_no_edit(registry: Registry, robot: RobotRecord) -> None:
    registry.robots.apply_blueprint(ROBOT, LIBRARY)
    assert registry.edits.latest(robot) == []


# Undo


def test_undo_goes_back_step_by_step_and_forward_again(registry: Registry, robot: RobotRecord) -> None:
    for value in (2, 3):
        Hand(registry).set_value(robot, "left", "period_s", value, "Ann")
    Hand(registry).undo(robot, None, "Ann")
    assert _period(registry, robot)[0] == 2
    last = Hand(registry).undo(robot, None, "Ann")
    assert _period(registry, robot)[0] == 1
    assert _refused(Hand(registry).undo, robot, None, "Ann") == "there is nothing to undo"
    Hand(registry).undo(robot, last.id, "Ann")
    assert _period(registry, robot)[0] == 2
    Hand(registry).undo(robot, None, "Ann")
    assert _period(registry, robot)[0] == 1


def test_what_cannot_be_undone(registry: Registry, robot: RobotRecord) -> None:
    first = Hand(registry).set_value(robot, "left", "period_s", 2, "Ann")
    Hand(registry).set_value(robot, "left", "period_s", 3, "Ann")
    assert _refused(Hand(registry).undo, robot, first.id, "Ann") == (
        "change 1 (period_s of left: 1 s -> 2 s) cannot be undone: "
        "it has been changed since; undo what came later first"
    )
    assert "there is no change 77 of this robot" in _refused(Hand(registry).undo, robot, 77, "Ann")
    Hand(registry).undo(robot, 2, "Ann")
    assert _refused(Hand(registry).undo, robot, 2, "Ann") == (
        "change 2 (period_s of left: 2 s -> 3 s) is undone already, by change 3"
    )
    registry.robots.apply_blueprint(replace(ROBOT, slots=(Slot("leg", "LEG"),), bindings=()), Library([*LIBRARY]))
    assert "there is no slot 'left'" in _refused(Hand(registry).undo, robot, first.id, "Ann")


def test_robots_have_their_own_edits(registry: Registry, robot: RobotRecord) -> None:
    other = registry.robots.apply_blueprint(replace(ROBOT, robot=replace(ROBOT.robot, name="R3")), LIBRARY)
    edit = Hand(registry).set_value(robot, "left", "period_s", 2, "Ann")
    assert registry.edits.latest(other) == []
    assert "there is no change" in _refused(Hand(registry).undo, other, edit.id, "Ann")


# When the database cannot be written


def test_a_running_robot_does_not_wait_long_for_another_program(
    registry: Registry, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = registry.robots.apply_blueprint(ROBOT, LIBRARY)
    waits: list[object] = []
    event.listen(
        registry.storage.engine, "begin", lambda one: waits.append(one.exec_driver_sql("PRAGMA busy_timeout").scalar())
    )
    Hand(registry).set_value(robot, "left", "period_s", 2, "Ann")
    registry.runs.begin(robot)
    Hand(registry).set_value(robot, "left", "period_s", 3, "Ann")
    assert [waits[0], waits[-1]] == [2000, 400]
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(RegistryError, match="is locked by another program"):
            Hand(registry).set_value(robot, "left", "period_s", 4, "Ann")
    assert _period(registry, robot)[0] == 3


def test_nothing_changes_while_the_database_cannot_be_written(impatient: Registry, path: Path) -> None:
    robot = impatient.robots.apply_blueprint(ROBOT, LIBRARY)
    store = impatient.runs.begin(robot)
    calls: list[EditRecord] = []
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(RegistryError, match="is locked by another program"):
            calls.append(Hand(impatient).set_value(robot, "left", "period_s", 2, "Ann"))
        store.remember(FIRST, "left", Claim("EYE", "one", FIRST))
        with pytest.raises(RegistryError, match=r"nothing was changed: the database .* is locked by another program"):
            calls.append(Hand(impatient).place(robot, FIRST, "right", "Ann"))
    assert calls == []
    assert store.remembered_slot(FIRST) == "left"
    assert Hand(impatient).place(robot, FIRST, "right", "Ann").id == 1
    assert store.remembered_slot(FIRST) == "right"
