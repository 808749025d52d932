"""What needs no bus: states of a drive, PDOs, emergencies, EDS files, addresses."""

from __future__ import annotations

from pathlib import Path

import pytest

from msbot.part.messages.standard import Switch, Temperature
from msbot_bridges.bridge import BridgeLink
from msbot_bridges.canopen.drive_states import DriveState, SetPoints, controlword, state_of
from msbot_bridges.canopen.emergency_words import emergency_words
from msbot_bridges.canopen.objects import CONTROLWORD, MODE, TARGET_VELOCITY, Entry
from msbot_bridges.canopen.pdo_layout import PdoLayout, distribute, mapped_entries
from msbot_bridges.canopen.port_mappings import analogue, bits_of, by_unit
from msbot_bridges.canopen.world import WORLD
from msbot_xrce.errors import ConfigError

pytest.importorskip("canopen")

from msbot_bridges.canopen.eds_folder import EdsFolder


def test_a_drive_is_led_to_operation_and_back() -> None:
    words = {0x240: 0x06, 0x221: 0x07, 0x223: 0x0F, 0x227: 0x0F}
    assert {word: controlword(state_of(word), wants_power=True, is_stopping=False) for word in words} == words
    assert controlword(DriveState.ENABLED, wants_power=True, is_stopping=True) == 0x02
    assert controlword(DriveState.QUICK_STOP, wants_power=True, is_stopping=True) == 0x02
    assert controlword(DriveState.READY, wants_power=True, is_stopping=True) == 0x02, "it may be enabled by now"
    assert controlword(DriveState.FAULT, wants_power=True, is_stopping=False) == 0x00, "no program resets a fault"


def test_each_set_point_is_taken_once_also_when_it_changes_before_it_is_acknowledged() -> None:
    acknowledged, points = 1 << 12, SetPoints()
    points.new()
    assert points.bits(0) == 0x30
    points.new()
    assert points.bits(0) == 0x30, "the bit stays until the drive has taken the first"
    assert points.bits(acknowledged) == 0x20
    assert points.bits(0) == 0x30, "and rises for the second"
    assert points.bits(acknowledged) == 0x20
    assert points.bits(0) == 0x20


def test_a_pdo_is_packed_and_unpacked() -> None:
    layout = PdoLayout(1, 0x205, (CONTROLWORD, MODE, TARGET_VELOCITY))
    data = layout.pack({CONTROLWORD: 0x0F, MODE: 3, TARGET_VELOCITY: -2})
    assert data == bytes.fromhex("0f0003feffffff")
    assert layout.unpack(data)[TARGET_VELOCITY] == -2
    assert layout.unpack(data[:3]) == {CONTROLWORD: 0x0F, MODE: 3}, "what is cut off is not made up"
    assert layout.pack({CONTROLWORD: 1 << 20})[:2] == b"\xff\xff"
    assert mapped_entries([0x60600008, 0x20010110], {(0x6060, 0): MODE}) == (MODE, Entry(0x2001, 1, 16))
    wide = [Entry(0x2000, number, 32) for number in range(5)]
    assert [len(pdo) for pdo in distribute(wide, 2)] == [2, 2]


def test_emergencies_are_said_in_words() -> None:
    assert emergency_words(0x8611, 0x21).startswith("emergency 0x8611: following error")
    assert emergency_words(0x3215, 4) == "emergency 0x3215: over-voltage of the DC link (error register: voltage)"
    assert emergency_words(0x2FFF, 0) == "emergency 0x2FFF: current"
    assert emergency_words(0x0123, 0) == "emergency 0x0123"


def test_numbers_become_messages() -> None:
    entry = Entry(0x6200, 1, 8)
    third = bits_of("out", entry, 1)[2]
    assert (third.port, third.to_message(0b100)) == ("out_3", Switch(on=True))
    assert third.to_value(Switch(on=False), 0b111) == 0b011
    level = analogue("level_out_1", Entry(0x6411, 1, 16, signed=True))
    assert level.to_value(level.message(percent=100), 0) == 32767
    warm = by_unit("oil", Entry(0x6130, 1, 16, signed=True), "°C", 0.1, is_truth=False)
    assert warm.message is Temperature
    assert warm.to_message(-55) == Temperature(celsius=-55 * 0.1)


EDS = """[DeviceInfo]
VendorName=ACME
VendorNumber=0x77
ProductName=Thermo
ProductNumber=0x{product}
[2001]
ParameterName=Filter time
DataType=0x0006
AccessType=rw
DefaultValue=10
LowLimit=1
HighLimit=500
[6130]
ParameterName=Oil temperature
DataType=0x0003
AccessType=ro
PDOMapping=1
Factor=0.1
Unit=°C
"""


def test_an_eds_is_found_by_vendor_and_product(tmp_path: Path) -> None:
    (tmp_path / "thermo.EDS").write_text(EDS.format(product=9), encoding="utf-8")
    folder = EdsFolder(tmp_path)
    assert folder.find(0x77, 8, 1) is None
    sheet = folder.find(0x77, 9, 1)
    assert sheet is not None
    (setting,) = sheet.settings()
    assert (setting.name, setting.least, setting.most, setting.default) == ("filter_time", 1, 500, 10)
    oil = sheet.variable(0x6130, 0)
    assert oil is not None
    assert (oil.unit, oil.factor) == ("°C", 0.1)


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ({"a.eds": "[DeviceInfo]\nVendorName=x\n"}, "needs VendorNumber and ProductNumber"),
        ({"a.eds": "nothing"}, "needs VendorNumber and ProductNumber"),
        ({"a.eds": EDS.format(product=9), "b.eds": EDS.format(product=9)}, "describe the same product"),
        ({"a.eds": EDS.format(product=9) + "[2002]\nParameterName=x\n"}, "a.eds: NoOptionError"),
    ],
)
def test_a_bad_eds_is_refused_with_its_name(tmp_path: Path, files: dict[str, str], words: str) -> None:
    for name, text in files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=words):
        EdsFolder(tmp_path)


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("can0", "write INTERFACE:CHANNEL"),
        ("socketcan:can0?bitrate=fast", "bitrate=N in bit/s"),
        ("socketcan:can0?speed=5", "bitrate=N in bit/s"),
    ],
)
def test_a_bad_address_is_refused(address: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        WORLD.open(BridgeLink(address))
    with pytest.raises(ConfigError, match="there is no such folder"):
        WORLD.open(BridgeLink("msbot:x", {"eds": "nowhere"}))
    with pytest.raises(ConfigError, match="from 1 to 126"):
        WORLD.simulated["drive"](BridgeLink("msbot:x"), {"node": "200"})
