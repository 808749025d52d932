"""What confirms that a CANopen device has stopped: what it was asked for after STOP, not what was on its way."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from msbot.part.messages.standard import Speed, Switch
from msbot_bridges.bridge import DeviceIdentity, ForeignDevice
from msbot_bridges.canopen.pdo_layout import PdoLayout
from msbot_bridges.canopen.port_mappings import bits_of

pytest.importorskip("canopen")

from msbot_bridges.canopen import objects
from msbot_bridges.canopen.canopen_device import (
    ENTER_PRE_OPERATIONAL,
    OPERATIONAL,
    PRE_OPERATIONAL,
    START,
    CanopenDevice,
    SetUp,
)
from msbot_bridges.canopen.drive_device import DriveDevice
from msbot_bridges.canopen.drive_states import QUICK_STOP
from msbot_bridges.canopen.mapped_device import MappedDevice
from msbot_bridges.canopen.node_description import DriveFacts, NodeDescription
from msbot_bridges.canopen.objects import Entry

STANDS, TURNS = 0x07, 0x27
"""Statuswords: QUICK STOP ACTIVE, OPERATION ENABLED."""
OUTPUTS = Entry(objects.DIGITAL_OUTPUTS, 1, 8)
WHO = DeviceIdentity("acme", "thing", b"1", "a thing", "node 5")


class Bus:
    """What a device has its bus do."""

    def __init__(self) -> None:
        self.commands: list[tuple[int, bool]] = []
        self.sent: list[tuple[bytes, bool]] = []
        self.asked: list[int] = []
        """Of which STOP."""
        self.written: list[tuple[Entry, int, bool]] = []
        self.news = 0

    def send(self, node_id: int, layout: PdoLayout, data: bytes, *, urgent: bool = False) -> None:
        self.sent.append((data, urgent))

    def command(self, node_id: int, command: int, *, urgent: bool = False) -> None:
        self.commands.append((command, urgent))

    def guard(self, node_id: int) -> None:
        raise AssertionError("it sends its heartbeat")

    def synchronise(self, node_id: int, *, is_needed: bool) -> None:
        assert not is_needed

    def set_up(self, device: CanopenDevice) -> None:
        device.configured(SetUp((), (PdoLayout(1, 0x205, _entries(device)),), 100))

    def read(self, device: CanopenDevice, entries: Sequence[Entry], stop: int = 0) -> None:
        self.asked.append(stop)

    def write(self, device: CanopenDevice, entry: Entry, value: int, *, urgent: bool = False) -> None:
        self.written.append((entry, value, urgent))

    def told(self, _: ForeignDevice) -> None:
        self.news += 1


def _entries(device: CanopenDevice) -> tuple[Entry, ...]:
    if isinstance(device, MappedDevice):
        return (OUTPUTS,)
    return (objects.CONTROLWORD, objects.MODE, objects.TARGET_VELOCITY)


def drive() -> tuple[DriveDevice, Bus]:
    facts = DriveFacts((objects.PROFILE_VELOCITY,), 1.0, None, True, False, False, None)
    bus = Bus()
    made = DriveDevice(NodeDescription(5, WHO, 100, facts), bus, bus.told)
    made.begin(lambda _port, _message: None)
    made.heartbeat(OPERATIONAL)
    return made, bus


def module() -> tuple[MappedDevice, Bus]:
    bus = Bus()
    description = NodeDescription(5, WHO, 100, told=list(bits_of("out", OUTPUTS, 1)))
    made = MappedDevice(description, bus, bus.told)
    made.begin(lambda _port, _message: None)
    made.heartbeat(OPERATIONAL)
    return made, bus


def test_a_report_that_was_on_its_way_is_no_confirmation() -> None:
    device, bus = drive()
    device.told({objects.STATUSWORD: TURNS, objects.VELOCITY: 0})
    device.act("speed", Speed(rpm=60))
    device.stop()
    assert bus.asked == [1]
    stands = {objects.STATUSWORD: STANDS, objects.VELOCITY: 0}
    device.told(stands)  # sent by the drive before it has heard of the order, or of STOP
    assert "has not reported that its drive stands" in device.not_stopped
    assert bus.asked == [1, 1], "it is asked at once whether it still stands"
    device.reported({objects.STATUSWORD: TURNS, objects.VELOCITY: 12}, 1)
    assert "has not reported that its drive stands" in device.not_stopped
    device.reported(stands, 1)
    assert "that it is PRE-OPERATIONAL" in device.not_stopped
    assert bus.commands[-1] == (ENTER_PRE_OPERATIONAL, True)


def test_an_answer_to_a_question_of_before_is_no_confirmation() -> None:
    device, bus = module()
    device.act("out_1", Switch(on=True))
    device.reported({OUTPUTS: 0}, 0)
    device.stop()
    device.reported({OUTPUTS: 0}, 0)
    assert "outputs have their safe values" in device.not_stopped
    device.reported({OUTPUTS: 0}, 1)
    assert "PRE-OPERATIONAL" in device.not_stopped
    device.heartbeat(PRE_OPERATIONAL)
    assert device.not_stopped == ""
    device.go()
    device.heartbeat(OPERATIONAL)
    device.stop()
    device.reported({OUTPUTS: 0}, 1)  # the late answer of the STOP before
    assert "outputs have their safe values" in device.not_stopped
    device.reported({OUTPUTS: 0}, 2)
    assert "PRE-OPERATIONAL" in device.not_stopped
    assert bus.asked == [1, 2]


def test_a_heartbeat_of_before_it_was_started_is_no_confirmation() -> None:
    device, bus = module()
    device.stop()
    device.reported({OUTPUTS: 0}, 1)
    device.heartbeat(PRE_OPERATIONAL)
    assert device.not_stopped == ""
    device.go()
    assert bus.commands[-1] == (START, False)
    device.heartbeat(PRE_OPERATIONAL)
    device.stop()  # before it has reported that it is OPERATIONAL
    device.reported({OUTPUTS: 0}, 2)
    device.heartbeat(PRE_OPERATIONAL)  # as it was before `go`
    assert "PRE-OPERATIONAL" in device.not_stopped
    device.heartbeat(PRE_OPERATIONAL)
    assert device.not_stopped == ""


@pytest.mark.parametrize("stops", [True, False])
def test_a_module_that_is_left_has_confirmed_its_safe_values_as_at_stop(stops: bool) -> None:
    device, bus = module()
    device.act("out_2", Switch(on=True))
    if stops:
        device.safe_is("out_1", Switch(on=True))
        device.stop()
    else:
        device.rests_at("out_1", Switch(on=True))
        device.rests_at("out_2", Switch(on=False))
        device.leave()
    assert bus.sent[-1] == (b"\x01", True)
    device.reported({OUTPUTS: 0}, 1)
    assert "outputs have their safe values" in device.not_stopped
    device.reported({OUTPUTS: 1}, 1)
    device.heartbeat(PRE_OPERATIONAL)
    assert device.not_stopped == ""
    device.end()
    assert bus.commands[-1] == (ENTER_PRE_OPERATIONAL, False)


def test_a_value_at_which_a_port_rested_is_not_that_of_the_next_stop() -> None:
    device, _ = module()
    device.rests_at("out_1", Switch(on=True))
    device.rest()
    device.act("out_1", Switch(on=True))
    device.stop()
    device.reported({OUTPUTS: 1}, 1)
    assert "outputs have their safe values" in device.not_stopped


def test_a_device_that_is_not_operational_is_told_by_sdo_before_others_are_set_up() -> None:
    device, bus = module()
    device.heartbeat(PRE_OPERATIONAL)
    device.leave()
    assert bus.sent == []
    assert bus.written == [(OUTPUTS, 0, True)]
    turning, bus = drive()
    turning.heartbeat(PRE_OPERATIONAL)
    turning.stop()
    assert bus.written == [(objects.CONTROLWORD, QUICK_STOP, True)]
