"""Applying a blueprint: what changes, what stays."""

from collections.abc import Sequence
from dataclasses import replace

import pytest
from sqlalchemy import Connection, insert, select

from msbot.config import (
    Binding,
    Blueprint,
    Direction,
    Library,
    Options,
    Parameter,
    ParameterKind,
    PartType,
    Port,
    RobotProfile,
    Slot,
    SlotPort,
    Timing,
)
from msbot.registry import Registry, RobotRecord, RobotStore
from msbot.registry.database.tables import bindings, library, metadata, robots, settings, slots
from msbot_xrce.errors import RegistryError
from tests.registry.events import CLAIM, UID

PROFILE = RobotProfile("R2", "V1", "007", "today", "us")
PERIOD = Parameter("period_s", ParameterKind.FLOAT, 0.5, "s", 0.01, 60, "how often")
INVERT = Parameter("invert", ParameterKind.BOOL, False)
EYE = PartType(
    "EYE",
    "Light sensor",
    "us",
    "sees",
    "5V",
    "10 bit",
    ports=(
        Port("light", Direction.PUBLISH, "Light", 2.0),
        Port("lamp", Direction.SUBSCRIBE, "Light", safe={"lux": 0}),
    ),
    parameters=(PERIOD, INVERT),
    compatible_with=("EYE-0",),
    source="msbot library, eye.toml",
)
LEG = PartType("LEG", "Motor", ports=(Port("goal", Direction.SUBSCRIBE, "Light"),))
LIBRARY = Library([EYE, LEG])
WIRE = Binding("brightness", "Light", SlotPort("left", "light"), (SlotPort("leg", "goal"),))
ROBOT = Blueprint(
    PROFILE, (Slot("left", "EYE", settings={"period_s": 1}), Slot("right", "EYE"), Slot("leg", "LEG", "LEG-1")), (WIRE,)
)


def _query(registry: Registry, *columns: object) -> list[tuple[object, ...]]:
    with registry.storage.engine.connect() as connection:
        return [tuple(row) for row in connection.execute(select(*columns))]  # type: ignore[call-overload]  # any columns


def _apply(registry: Registry, blueprint: Blueprint, part_types: Library = LIBRARY) -> RobotStore:
    return registry.runs.begin(registry.robots.apply_blueprint(blueprint, part_types))


def _versions(store: RobotStore, names: Sequence[str] = ("left", "right", "leg")) -> list[int]:
    return [store.configuration(name).version for name in names]


def _set_by_hand(registry: Registry, slot: str, name: str, value: float) -> None:
    def write(connection: Connection) -> None:
        slot_id = connection.execute(select(slots.c.id).where(slots.c.name == slot)).scalar_one()
        row = {"slot_id": slot_id, "name": name, "origin": "hand", "value": value, "changed_ns": 1}
        connection.execute(insert(settings).values(row))

    registry.storage.write(write)


def test_a_robot_is_stored_with_all_it_has(registry: Registry) -> None:
    timing, options = Timing("fast", 0.25, 0.5, 4, 1.0), Options(explain=True, free_topics=("chat",))
    robot = registry.robots.apply_blueprint(replace(ROBOT, timing=timing, options=options), LIBRARY)
    assert robot == RobotRecord(1, "R2", "007", "V1", "today", "us", 1_700_000_000_000_000_000)
    columns = [robots.c[name] for name in ("beat_period_s", "tick_period_s", "life", "profile_period_s", "explain")]
    assert _query(registry, *columns, robots.c.free_topics) == [(0.25, 0.5, 4, 1.0, True, ["chat"])]
    assert sorted(_query(registry, slots.c.position, slots.c.name, slots.c.part_number, slots.c.local_name)) == [
        (0, "left", "EYE", ""),
        (1, "right", "EYE", ""),
        (2, "leg", "LEG", "LEG-1"),
    ]
    assert _query(registry, settings.c.name, settings.c.origin, settings.c.value, settings.c.slot_id) == [
        ("period_s", "library", 0.5, 1),
        ("invert", "library", False, 1),
        ("period_s", "blueprint", 1, 1),
        ("period_s", "library", 0.5, 2),
        ("invert", "library", False, 2),
    ]
    assert _query(registry, bindings.c.topic, bindings.c.slot_id, bindings.c.port, bindings.c.publishes) == [
        ("brightness", 1, "light", True),
        ("brightness", 3, "goal", False),
    ]


def test_the_library_is_stored_whole(registry: Registry) -> None:
    registry.robots.apply_blueprint(ROBOT, LIBRARY)
    rows = _query(registry, library.c.number, library.c.compatible_with, library.c.ports, library.c.parameters)
    assert rows[0] == (
        "EYE",
        ["EYE-0"],
        [
            {"name": "light", "direction": "publish", "type": "Light", "rate_hz": 2.0, "safe": None},
            {"name": "lamp", "direction": "subscribe", "type": "Light", "rate_hz": 0.0, "safe": {"lux": 0}},
        ],
        [
            {
                "name": "period_s",
                "type": "float",
                "default": 0.5,
                "unit": "s",
                "min": 0.01,
                "max": 60,
                "description": "how often",
            },
            {
                "name": "invert",
                "type": "bool",
                "default": False,
                "unit": "",
                "min": None,
                "max": None,
                "description": "",
            },
        ],
    )


def test_applying_the_same_again_changes_nothing_but_the_time(registry: Registry) -> None:
    _apply(registry, ROBOT)
    tables = [table for table in metadata.sorted_tables if table.name not in ("robots", "bindings")]
    # A row that is written anew, with what it had, may come elsewhere in an answer without an order.
    before = [sorted(_query(registry, table), key=repr) for table in tables]
    assert _versions(_apply(registry, ROBOT)) == [1, 1, 1]
    assert [sorted(_query(registry, table), key=repr) for table in tables] == before
    assert len(_query(registry, bindings)) == 2
    assert [robot.id for robot in registry.robots.all()] == [1]


def test_only_a_changed_configuration_gets_another_version(registry: Registry) -> None:
    assert _versions(_apply(registry, ROBOT)) == [1, 1, 1]
    left = replace(ROBOT.slots[0], settings={"period_s": 2})
    changed = replace(ROBOT, slots=(left, *ROBOT.slots[1:]))
    assert _versions(_apply(registry, changed)) == [2, 1, 1]
    assert _versions(_apply(registry, replace(changed, bindings=()))) == [3, 1, 2]
    other_default = Library([replace(EYE, parameters=(replace(PERIOD, default=9.0), INVERT)), LEG])
    assert _versions(_apply(registry, replace(changed, bindings=()), other_default)) == [3, 2, 2]


def test_one_is_not_true(registry: Registry) -> None:
    _apply(registry, replace(ROBOT, slots=(Slot("left", "EYE", settings={"period_s": 1}),), bindings=()))
    truth = {"period_s": True}  # the reader would refuse it; the comparison must not mix the two up
    store = _apply(registry, replace(ROBOT, slots=(Slot("left", "EYE", settings=truth),), bindings=()))
    assert dict(store.configuration("left").settings)["period_s"] == "true"


def test_the_blueprint_goes_before_the_library_and_a_hand_before_both(registry: Registry) -> None:
    store = _apply(registry, ROBOT)
    assert dict(store.configuration("left").settings) == {"invert": "false", "period_s": "1"}
    assert dict(store.configuration("right").settings) == {"invert": "false", "period_s": "0.5"}
    _set_by_hand(registry, "left", "period_s", 7)
    store = _apply(registry, ROBOT)
    assert dict(store.configuration("left").settings)["period_s"] == "7"
    left = replace(ROBOT.slots[0], settings={"period_s": 3})
    store = _apply(registry, replace(ROBOT, slots=(left, *ROBOT.slots[1:])))
    assert dict(store.configuration("left").settings)["period_s"] == "7"


def test_a_value_set_by_hand_goes_with_its_parameter(registry: Registry) -> None:
    _apply(registry, ROBOT)
    _set_by_hand(registry, "left", "period_s", 7)
    legs = replace(ROBOT, slots=(Slot("left", "LEG"), *ROBOT.slots[1:]), bindings=())
    assert _apply(registry, legs).configuration("left").settings == ()


def test_a_slot_that_is_taken_out_and_comes_back_has_lost_nothing(registry: Registry) -> None:
    store = _apply(registry, ROBOT)
    store.remember(UID, "left", CLAIM)
    _set_by_hand(registry, "left", "period_s", 7)
    registry.storage.flush()
    without = _apply(registry, replace(ROBOT, slots=ROBOT.slots[1:], bindings=()))
    assert [slot.name for slot in without.slots()] == ["right", "leg"]
    assert without.remembered_slot(UID) is None
    back = _apply(registry, ROBOT)
    assert [slot.name for slot in back.slots()] == ["left", "right", "leg"]
    assert back.remembered_slot(UID) == "left"
    assert dict(back.configuration("left").settings)["period_s"] == "7"


def test_the_order_of_the_blueprint_is_kept(registry: Registry) -> None:
    _apply(registry, ROBOT)
    turned = replace(ROBOT, slots=tuple(reversed(ROBOT.slots)))
    assert [slot.name for slot in _apply(registry, turned).slots()] == ["leg", "right", "left"]


def test_a_receiver_of_two_senders_is_bound_once(registry: Registry) -> None:
    second = replace(WIRE, source=SlotPort("right", "light"))
    store = _apply(registry, replace(ROBOT, bindings=(WIRE, second)))
    assert [binding.topic for binding in store.configuration("leg").bindings] == ["brightness"]


def test_several_robots_share_a_database_and_nothing_else(registry: Registry) -> None:
    first = _apply(registry, ROBOT)
    other = replace(ROBOT, robot=replace(PROFILE, serial_number="008"), slots=(Slot("left", "LEG"),), bindings=())
    second = _apply(registry, other)
    first.remember(UID, "left", CLAIM)
    registry.storage.flush()
    assert [robot.serial_number for robot in registry.robots.all()] == ["008", "007"]
    assert [slot.name for slot in first.slots()] == ["left", "right", "leg"]
    assert [slot.part_number for slot in second.slots()] == ["LEG"]
    assert _apply(registry, other).remembered_slot(UID) is None


def test_a_new_version_of_a_robot_is_the_same_robot(registry: Registry) -> None:
    first = registry.robots.apply_blueprint(ROBOT, LIBRARY)
    second = registry.robots.apply_blueprint(replace(ROBOT, robot=replace(PROFILE, version="V2")), LIBRARY)
    assert (second.id, second.version) == (first.id, "V2")


def test_the_library_forgets_what_no_slot_needs(registry: Registry) -> None:
    spare = PartType("SPARE", "not used")
    registry.robots.apply_blueprint(ROBOT, Library([EYE, LEG, spare]))
    other = replace(ROBOT, robot=replace(PROFILE, name="R3"), slots=(Slot("leg", "LEG"),), bindings=())
    registry.robots.apply_blueprint(other, Library([replace(LEG, name="Better motor")]))
    assert sorted(_query(registry, library.c.number, library.c.name)) == [
        ("EYE", "Light sensor"),
        ("LEG", "Better motor"),
    ]


def test_all_or_nothing(registry: Registry, monkeypatch: pytest.MonkeyPatch) -> None:
    registry.robots.apply_blueprint(ROBOT, LIBRARY)
    before = [_query(registry, table) for table in metadata.sorted_tables]
    lost = replace(ROBOT, slots=(Slot("x", "LEG"), Slot("y", None)))  # type: ignore[arg-type]  # a mistake on purpose
    with pytest.raises(RegistryError, match=r"part_number.*: mend that"):
        registry.robots.apply_blueprint(lost, LIBRARY)
    assert [_query(registry, table) for table in metadata.sorted_tables] == before


def test_the_safe_values_of_bound_ports_travel_with_the_settings_and_a_change_of_them_is_a_change(
    registry: Registry,
) -> None:
    wires = (WIRE, Binding("glow", "Light", SlotPort("right", "light"), (SlotPort("left", "lamp"),)))
    store = _apply(registry, replace(ROBOT, bindings=wires))
    assert ("lamp.safe.lux", "0") in store.configuration("left").settings
    assert not [name for name, _ in store.configuration("right").settings if ".safe." in name]
    before = _versions(store)
    brighter = replace(EYE, ports=(EYE.ports[0], replace(EYE.ports[1], safe={"lux": 5})))
    store = _apply(registry, replace(ROBOT, bindings=wires), Library([brighter, LEG]))
    assert ("lamp.safe.lux", "5") in store.configuration("left").settings
    assert _versions(store) == [before[0] + 1, *before[1:]]


def test_a_safe_value_of_the_slot_goes_before_the_librarys_with_or_without_a_wire_and_comes_back(
    registry: Registry,
) -> None:
    stated = replace(
        ROBOT,
        slots=tuple(replace(one, safe={"lamp": {"lux": 7}}) if one.name == "left" else one for one in ROBOT.slots),
    )
    store = _apply(registry, ROBOT)
    before = _versions(store)
    store = _apply(registry, stated)
    assert ("lamp.safe.lux", "7") in store.configuration("left").settings
    assert _versions(store) == [before[0] + 1, *before[1:]]
    assert store.blueprint.slots == stated.slots
    wires = (WIRE, Binding("glow", "Light", SlotPort("right", "light"), (SlotPort("left", "lamp"),)))
    store = _apply(registry, replace(stated, bindings=wires))
    assert ("lamp.safe.lux", "7") in store.configuration("left").settings
    store = _apply(registry, replace(ROBOT, bindings=wires))
    assert ("lamp.safe.lux", "0") in store.configuration("left").settings
