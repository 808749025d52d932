"""What registers, subjects, node ids and data types mean, without a bus."""

from __future__ import annotations

import asyncio
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from msbot.part import Message
from msbot.part.messages.standard import (
    Angle,
    Battery,
    Distance,
    Level,
    Number,
    Speed,
    Switch,
    Temperature,
    Text,
    Vector,
)
from msbot_bridges.bridge import DeviceIdentity, ForeignDevice, Value
from msbot_bridges.cyphal.aspect import FEEDBACK, READINESS, Builtin
from msbot_bridges.cyphal.node_device import CyphalNode
from msbot_bridges.cyphal.node_ids import GivenNodeIds, hash_of
from msbot_bridges.cyphal.node_registers import Register, RegisterSetting, SubjectPort, ports_of, settings_of
from msbot_bridges.cyphal.port_types import TYPES, short_name
from msbot_bridges.cyphal.subjects import FIRST, LAST, Subjects
from tests.bridges.hosts import Host


def natural(value: int, **flags: bool) -> Register:
    return Register("natural16", (value,), **flags)


def port(kind: str, name: str, subject: int, type_name: str, **flags: bool) -> dict[str, Register]:
    start = f"uavcan.{kind}.{name}"
    return {f"{start}.id": natural(subject, **flags), f"{start}.type": Register("string", (type_name,), False)}


class Bus:
    """What a device says to its bus."""

    def __init__(self) -> None:
        self.sent: list[tuple[str, Builtin, bool]] = []
        self.told = 0

    def take_in(self, device: CyphalNode) -> None:
        pass

    def listen(self, device: CyphalNode) -> None:
        pass

    def leave(self, device: CyphalNode) -> None:
        pass

    def publish(
        self, device: CyphalNode, port: SubjectPort, fields: Builtin, *, urgent: bool, again: bool = False
    ) -> None:
        self.sent.append((port.name, fields, urgent))

    def write(self, device: CyphalNode, setting: RegisterSetting, value: Value) -> None:
        pass

    def restart(self, node_id: int) -> None:
        pass

    def update(self, device: CyphalNode, image: str) -> None:
        pass

    def identify(self, node_id: int) -> None:
        pass

    def news(self, device: ForeignDevice) -> None:
        self.told += 1


def device(registers: dict[str, Register]) -> tuple[CyphalNode, Bus]:
    bus = Bus()
    who = DeviceIdentity("com.acme", "thing", b"1", "a thing")
    return CyphalNode(who, 9, ports_of(registers), settings_of(registers), bus), bus


ANGLE, SPEED = "uavcan.si.unit.angle.Scalar.1.0", "uavcan.si.unit.angular_velocity.Scalar.1.0"
PLANAR = "reg.udral.physics.dynamics.rotation.Planar.0.1"


def test_ports_are_what_the_registers_say() -> None:
    registers = {
        **port("pub", "front.range", 7, "uavcan.si.sample.length.Scalar.1.0"),
        **port("pub", "2500", 2500, "uavcan.si.sample.temperature.Scalar.1.0"),
        **port("pub", "raw", 8, "com.acme.Raw.1.0"),
        **port("sub", "axis", 65535, PLANAR, is_persistent=False),
        "uavcan.srv.thing.id": natural(3),
    }
    made, _ = device(registers)
    assert [(one.name, one.message) for one in made.outputs] == [
        ("front_range", Distance),
        ("subject_2500", Temperature),
    ]
    inputs: dict[str, type[Message]] = {"axis_angle": Angle, "axis_speed": Speed}
    assert {one.name: one.message for one in made.inputs} == inputs
    assert made.left_out == ["raw (com.acme.Raw.1.0)"]
    axis = made.ports.subscribed[0]
    assert (axis.subject, axis.is_kept) == (None, False)


def test_a_part_has_no_name_twice() -> None:
    registers = {
        **port("pub", "angle", 1, "uavcan.si.sample.angle.Scalar.1.0"),
        **port("pub", "front.range", 2, "uavcan.si.sample.length.Scalar.1.0"),
        **port("pub", "front_range", 3, "uavcan.si.sample.length.Scalar.1.0"),
        **port("pub", "restart", 4, "uavcan.primitive.scalar.Bit.1.0"),
        **port("sub", "angle", 5, ANGLE),
    }
    made, _ = device(registers)
    assert [one.name for one in made.inputs] == ["angle"]
    assert [one.name for one in made.outputs] == ["angle_state", "front_range", "front_range_state", "restart_state"]
    assert made.left_out == []


def test_settings_have_range_and_default_and_no_dots() -> None:
    registers = {
        "motor.gain": Register("real32", (2.5,)),
        "motor.gain<": Register("real32", (10.0,), False),
        "motor.gain>": Register("real32", (0.5,), False),
        "motor.gain=": Register("real32", (1.5,), False),
        "motor.poles": Register("natural8", (14,)),
        "motor.reverse": Register("bit", (True,)),
        "name": Register("string", ("left",)),
        "motor.state": Register("natural8", (1,), False),
        "motor.table": Register("real32", (1.0, 2.0)),
        "motor.unset": Register("real32", (math.nan,)),
        "uavcan.node.id": natural(9),
        "*raw": natural(1),
    }
    found = {one.declared.name: (one.declared.kind, one.declared.default) for one in settings_of(registers)}
    assert found == {
        "motor_gain": (float, 1.5),
        "motor_poles": (int, 14),
        "motor_reverse": (bool, True),
        "name": (str, "left"),
    }
    gain, poles, *_ = (one.declared for one in settings_of(registers))
    assert (gain.least, gain.most, poles.least, poles.most) == (0.5, 10.0, 0, 255)


@pytest.mark.parametrize(
    ("type_name", "told", "message"),
    [
        ("uavcan.si.unit.length.Scalar.1.0", {"meter": 1.5}, Distance(metres=1.5, in_range=True)),
        ("uavcan.si.unit.length.Scalar.1.0", {"meter": math.nan}, Distance(metres=0.0, in_range=False)),
        ("uavcan.si.sample.temperature.Scalar.1.0", {"kelvin": 300.15}, Temperature(celsius=27.0)),
        ("uavcan.si.sample.velocity.Vector3.1.0", {"meter_per_second": [1.0, 2.0, 3.0]}, Vector(x=1.0, y=2.0, z=3.0)),
        ("uavcan.primitive.scalar.Bit.1.0", {"value": True}, Switch(on=True)),
        ("uavcan.primitive.String.1.0", {"value": b"hi"}, Text(text="hi")),
    ],
)
def test_what_a_node_publishes_is_a_standard_message(type_name: str, told: dict[str, Any], message: Message) -> None:
    (aspect,) = TYPES[type_name]
    assert aspect.read is not None
    found = aspect.read(SimpleNamespace(**told))
    assert str(found) == str(message)


def test_a_battery_says_how_full_it_is() -> None:
    power = SimpleNamespace(voltage=SimpleNamespace(volt=11.5), current=SimpleNamespace(ampere=2.0))
    joule = [SimpleNamespace(joule=number) for number in (25.0, 100.0)]
    told = SimpleNamespace(value=SimpleNamespace(power=power, energy=joule[0], full_energy=joule[1]))
    (aspect,) = TYPES["reg.udral.physics.electricity.SourceTs.0.1"]
    assert aspect.read is not None
    assert aspect.read(told) == Battery(volts=11.5, amperes=2.0, percent=25.0)


@pytest.mark.parametrize(
    ("type_name", "message", "fields"),
    [
        ("uavcan.primitive.scalar.Integer8.1.0", Number(value=1000.0), {"value": 127}),
        ("uavcan.primitive.scalar.Natural16.1.0", Number(value=-3.0), {"value": 0}),
        ("uavcan.primitive.scalar.Bit.1.0", Switch(on=True), {"value": True}),
        ("reg.udral.service.actuator.common.sp.Scalar.0.1", Level(percent=-50.0), {"value": -0.5}),
        (ANGLE, Angle(degrees=180.0), {"radian": math.pi}),
        (SPEED, Speed(rpm=30.0), {"radian_per_second": math.pi}),
    ],
)
def test_what_drives_a_node_is_in_its_units(type_name: str, message: Message, fields: Builtin) -> None:
    (aspect,) = TYPES[type_name]
    assert aspect.write is not None
    assert aspect.write(message) == pytest.approx(fields)


def test_names_for_tables_are_short() -> None:
    assert (short_name(ANGLE), short_name(PLANAR)) == ("angle", "Planar")


def stopped_by_reports(*ports: dict[str, Register]) -> tuple[CyphalNode, Bus]:
    made, bus = device({name: one for registers in ports for name, one in registers.items()})
    made.begin(lambda _port, _message: None)
    return made, bus


def test_stop_takes_the_readiness_away_and_waits_for_the_feedback() -> None:
    made, bus = stopped_by_reports(
        port("sub", "setpoint", 1, PLANAR), port("sub", "readiness", 2, READINESS), port("pub", "feedback", 3, FEEDBACK)
    )
    assert bus.sent == [("readiness", {"value": 3}, False)]
    made.act("setpoint_angle", Angle(degrees=20))
    made.stop()
    assert ("readiness", {"value": 2}, True) in bus.sent
    name, fields, urgent = bus.sent[-1]
    assert (name, urgent, fields["kinematics"]["angular_position"]) == ("setpoint", True, {"radian": 0.0})
    (feedback,) = made.ports.published
    for readiness, why in ((3, "node 9 has not reported that it is disengaged"), (2, "")):
        heartbeat = SimpleNamespace(readiness=SimpleNamespace(value=readiness))
        made.heard(feedback, SimpleNamespace(heartbeat=heartbeat, demand_factor_pct=0))
        assert made.not_stopped == why
    made.act("setpoint_angle", Angle(degrees=20))
    assert bus.sent[-1] == (name, fields, urgent), "what comes during STOP goes nowhere"
    made.go()
    assert bus.sent[-1] == ("readiness", {"value": 3}, False)


def test_without_feedback_a_report_of_the_same_quantity_confirms_stop() -> None:
    made, bus = stopped_by_reports(
        port("sub", "speed", 1, SPEED), port("pub", "turns", 2, "uavcan.si.sample.angular_velocity.Scalar.1.0")
    )
    made.act("speed", Speed(rpm=60))
    made.stop()
    assert bus.sent[-1] == ("speed", {"radian_per_second": 0.0}, True)
    for radian_per_second, why in ((3.0, "node 9 has not reported that speed has its safe value"), (0.0, "")):
        made.heard(made.ports.published[0], SimpleNamespace(radian_per_second=radian_per_second))
        assert made.not_stopped == why


def test_the_safe_value_of_the_library_is_sent_and_waited_for() -> None:
    made, bus = stopped_by_reports(
        port("sub", "axis", 1, PLANAR), port("pub", "position", 2, "uavcan.si.sample.angle.Scalar.1.0")
    )
    made.safe_is("axis_angle", Angle(degrees=90))
    made.stop()
    name, fields, _ = bus.sent[-1]
    assert (name, fields["kinematics"]["angular_position"]["radian"]) == ("axis", pytest.approx(math.pi / 2))
    for radian, why in ((0.0, "node 9 has not reported that axis_angle has its safe value"), (1.58, "")):
        made.heard(made.ports.published[0], SimpleNamespace(radian=radian))
        assert made.not_stopped == why


def test_a_node_that_reports_nothing_cannot_confirm_stop() -> None:
    made, bus = stopped_by_reports(port("sub", "valve", 1, "uavcan.primitive.scalar.Bit.1.0"))
    made.act("valve", Switch(on=True))
    made.stop()
    assert bus.sent[-1] == ("valve", {"value": False}, True)
    assert made.not_stopped == "node 9 cannot report that valve has its safe value"


def test_orders_are_repeated_until_the_device_leaves() -> None:
    made, bus = stopped_by_reports(port("sub", "speed", 1, SPEED))
    made.repeat()
    assert not bus.sent, "nobody has driven it"
    made.act("speed", Speed(rpm=60))
    made.repeat()
    assert len(bus.sent) == 2
    made.end()
    made.repeat()
    assert len(bus.sent) == 2


def test_modes_and_health_are_faults() -> None:
    made, bus = device({})
    for health, mode, words in (
        (3, 0, "node 9 says that its health is WARNING"),
        (3, 3, "node 9 is updating its software"),
        (2, 1, "node 9 is starting"),
        (2, 0, ""),
    ):
        made.heartbeat(health, mode)
        assert made.fault == words
    assert bus.told == 4


def test_a_node_id_is_kept_and_forgotten_when_it_is_needed() -> None:
    ids = GivenNodeIds(1, 3)
    assert [ids.give(unique, ()) for unique in (10, 20, 30, 10)] == [3, 2, 1, 3]
    assert ids.give(40, {3, 2, 1}) is None, "all nodes are there"
    assert ids.give(40, {3, 1}) == 2, "the one that is gone is forgotten"
    ids.seen(3, 40)
    assert ids.give(40, {3}) == 3, "the newest word counts"
    assert ids.give(50, {125}) == 2


def test_the_hash_of_a_unique_id_is_that_of_the_standard() -> None:
    assert hash_of(b"123456789") == 0x62EC59E3F1A4F00A & (1 << 48) - 1


def test_subjects_are_given_once_and_kept_for_nodes_that_are_gone() -> None:
    subjects = Subjects()
    subjects.uses(7, "published", [FIRST])
    subjects.uses(7, "published list", [FIRST + 1])
    assert subjects.give(b"a", ["x", "y"]) == {"x": FIRST + 2, "y": FIRST + 3}
    assert subjects.give(b"b", ["x"]) == {"x": FIRST + 4}
    subjects.forget(7)
    assert subjects.give(b"c", ["x", "y", "z"]) == {"x": FIRST, "y": FIRST + 1, "z": FIRST + 5}
    assert len(subjects.give(b"d", [str(number) for number in range(LAST)])) == LAST - FIRST - 5, "no more are free"
    subjects.uses(8, "subscribed list", [5])
    assert (subjects.others("subscribed", 5, 1), subjects.others("published", 5, 1)) == ([8], [])
    assert subjects.others("subscribed", 5, 8) == []


def test_data_types_appear_whole_whoever_else_makes_them(tmp_path: Path) -> None:
    pytest.importorskip("pycyphal")
    from msbot_bridges.cyphal.data_types import LATEST, compile_types, folder_of_types

    definitions, place = tmp_path / "dsdl", tmp_path / "cache" / "types"
    for name in ("uavcan", "reg"):
        (definitions / name).mkdir(parents=True)
        (definitions / name / "A.1.0.dsdl").write_text("uint8 value\n@sealed\n")
    for _ in range(2):  # the second finds that somebody was first
        compile_types(place, definitions)
    assert sorted(path.name for path in place.iterdir()) == ["nunavut_support.py", "reg", "uavcan"]
    assert [path.name for path in place.parent.iterdir()] == ["types"]
    for number in range(LATEST + 1):
        compile_types(place.with_name(f"other{number}"), definitions)
    assert len(list(place.parent.iterdir())) == LATEST
    assert folder_of_types(tmp_path).parent == tmp_path / "cyphal"


def test_a_cache_that_cannot_be_written_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pycyphal")
    from msbot_bridges.cyphal import data_types
    from msbot_bridges.cyphal.cyphal_world import CyphalWorld
    from msbot_xrce.errors import LinkDown

    (tmp_path / "file").write_text("")
    monkeypatch.setattr(data_types, "folder_of_types", lambda: tmp_path / "file" / "types")
    with pytest.raises(LinkDown, match=r"file/types, where a folder is needed that can be written \(.*Error"):
        asyncio.run(CyphalWorld("msbot:x").run(Host()))
