"""Objects of the dictionaries that CiA 301, 401 and 402 name: where they are, and what is in them.

What a device of these profiles has without an EDS; an EDS adds its own objects.
"""

from __future__ import annotations

from typing import Final

from msbot_xrce.lazy import dataclass


@dataclass(frozen=True, slots=True)
class Entry:
    """One number of an object dictionary."""

    index: int
    subindex: int
    bits: int
    signed: bool = False

    @property
    def where(self) -> str:
        """As manuals write it: `0x6081:00`."""
        return f"0x{self.index:04X}:{self.subindex:02X}"

    @property
    def mapping(self) -> int:
        """The entry as a PDO's mapping names it."""
        return self.index << 16 | self.subindex << 8 | self.bits

    @property
    def least(self) -> int:
        """The smallest number that it can hold."""
        return -(1 << self.bits - 1) if self.signed else 0

    @property
    def most(self) -> int:
        """The biggest number that it can hold."""
        return (1 << self.bits - self.signed) - 1

    def encode(self, value: int) -> bytes:
        """A number as octets; one beyond what it can hold becomes the nearest that it can."""
        value = max(self.least, min(self.most, value))
        return value.to_bytes(self.bits + 7 >> 3, "little", signed=self.signed)

    def decode(self, data: bytes) -> int:
        """A number from octets; some devices send more than the entry has."""
        return int.from_bytes(data[: self.bits + 7 >> 3], "little", signed=self.signed)


@dataclass(frozen=True, slots=True)
class SettingEntry:
    """An entry that a device keeps, and that its slot sets."""

    name: str
    entry: Entry
    kind: type[int] | type[float] = int
    factor: float = 1.0
    """The value of the setting for one unit of the entry."""
    least: float | None = None
    most: float | None = None
    default: float | None = None
    """None: what the device has when it is found."""
    unit: str = ""


DEVICE_TYPE: Final = Entry(0x1000, 0, 32)
ERROR_REGISTER: Final = Entry(0x1001, 0, 8)
SYNC_COB_ID: Final = Entry(0x1005, 0, 32)
GUARD_TIME: Final = Entry(0x100C, 0, 16)
LIFE_FACTOR: Final = Entry(0x100D, 0, 8)
CONSUMER_HEARTBEAT: Final = Entry(0x1016, 1, 32)
PRODUCER_HEARTBEAT: Final = Entry(0x1017, 0, 16)
VENDOR, PRODUCT, REVISION, SERIAL = (Entry(0x1018, number, 32) for number in (1, 2, 3, 4))
DEVICE_NAME, HARDWARE_VERSION, SOFTWARE_VERSION = 0x1008, 0x1009, 0x100A

# Drives, CiA 402
CONTROLWORD: Final = Entry(0x6040, 0, 16)
STATUSWORD: Final = Entry(0x6041, 0, 16)
MODE: Final = Entry(0x6060, 0, 8, signed=True)
TARGET_TORQUE: Final = Entry(0x6071, 0, 16, signed=True)
MAX_TORQUE: Final = Entry(0x6072, 0, 16)
TORQUE: Final = Entry(0x6077, 0, 16, signed=True)
POSITION: Final = Entry(0x6064, 0, 32, signed=True)
VELOCITY: Final = Entry(0x606C, 0, 32, signed=True)
TARGET_POSITION: Final = Entry(0x607A, 0, 32, signed=True)
ENCODER_INCREMENTS: Final = Entry(0x608F, 1, 32)
ENCODER_TURNS: Final = Entry(0x608F, 2, 32)
GEAR_MOTOR: Final = Entry(0x6091, 1, 32)
GEAR_SHAFT: Final = Entry(0x6091, 2, 32)
VELOCITY_UNIT: Final = Entry(0x60A9, 0, 32)
TARGET_VELOCITY: Final = Entry(0x60FF, 0, 32, signed=True)
MODES: Final = Entry(0x6502, 0, 32)

THOUSANDTH: Final = 0.1
"""A unit of torque is a thousandth of the motor's rated torque (0x6076): in percent."""
PROFILE_POSITION, PROFILE_VELOCITY, PROFILE_TORQUE = 1, 3, 4
"""Modes of operation, as 0x6060 has them; bit N - 1 of 0x6502 says that a drive has mode N."""

DRIVE_SETTINGS: Final = (
    SettingEntry("profile_velocity", Entry(0x6081, 0, 32)),
    SettingEntry("profile_acceleration", Entry(0x6083, 0, 32)),
    SettingEntry("profile_deceleration", Entry(0x6084, 0, 32)),
    SettingEntry("quick_stop_deceleration", Entry(0x6085, 0, 32)),
    SettingEntry("max_motor_speed", Entry(0x6080, 0, 32), unit="rpm"),
    SettingEntry("max_torque", MAX_TORQUE, float, THOUSANDTH, unit="%"),
    SettingEntry("torque_slope", Entry(0x6087, 0, 32), float, THOUSANDTH, unit="%/s"),
    SettingEntry("max_current", Entry(0x6073, 0, 16), float, 0.1, unit="%"),
    SettingEntry("least_position", Entry(0x607D, 1, 32, signed=True)),
    SettingEntry("most_position", Entry(0x607D, 2, 32, signed=True)),
    SettingEntry("following_error_window", Entry(0x6065, 0, 32)),
)

# Input and output modules, CiA 401: each object has an entry for eight bits, or for one analogue value.
DIGITAL_INPUTS, DIGITAL_OUTPUTS, ANALOGUE_INPUTS, ANALOGUE_OUTPUTS = 0x6000, 0x6200, 0x6401, 0x6411
ANALOGUE_INTERRUPTS: Final = Entry(0x6423, 0, 8)
"""Analogue inputs are sent only when this is true."""
IO_SETTINGS: Final = (
    SettingEntry("polarity_in", Entry(0x6002, 1, 8)),
    SettingEntry("filter_in", Entry(0x6003, 1, 8)),
    SettingEntry("polarity_out", Entry(0x6202, 1, 8)),
    SettingEntry("error_mode_out", Entry(0x6206, 1, 8)),
    SettingEntry("error_value_out", Entry(0x6207, 1, 8)),
    SettingEntry("interrupt_delta_1", Entry(0x6426, 1, 32)),
)
