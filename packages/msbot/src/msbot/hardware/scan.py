"""What is plugged in: chips on I2C, USB devices, 1-Wire, converters, CAN interfaces; each with a command for it."""

from __future__ import annotations

import errno
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from msbot.config import BusKind, Library
from msbot.hardware.drivers.kernel_sensors import IIO, W1
from msbot.hardware.hardware_fault import HardwareFault
from msbot.hardware.i2c import SmBus
from msbot.hardware.machine import Machine
from msbot_xrce.counting import amount
from msbot_xrce.lazy import dataclass

FIRST, LAST = 0x08, 0x77
READ_ONLY = (range(0x30, 0x38), range(0x50, 0x60))
"""Addresses of memories: they are probed by a read, safer for them than the empty write used elsewhere (as i2cdetect
does)."""
MOST_ENTRIES = 1000
"""Most devices of one kind that are examined."""
VL53L0X_ADDRESS = 0x29
"""The chip's address while the kernel does not drive it yet."""
ARPHRD_CAN = 280
"""linux/if_arp.h"""
NUMATO = "2a19"
SLCAN = {("ad50", "60c4"), ("16d0", "117e"), ("1cd2", "606f")}
"""CANable with slcan firmware, and other adapters with the same USB identification."""
BOARDS = {"2e8a": "a board with RP2040 or RP2350", "f055": "a board with MicroPython", "303a": "a board with ESP32"}
"""USB vendors of boards that can run a MicroPython part."""


@dataclass(frozen=True, slots=True)
class FoundThing:
    """Something that is plugged in."""

    kind: str
    """`i2c`, `usb`, `1-wire`, `converter`, `sensor` or `can`."""
    where: str
    """Address, path or name."""
    words: str
    """What it is, as far as is known."""
    lines: tuple[str, ...]
    """The commands that make it a part or a link; several when it could be several things."""


@dataclass(frozen=True, slots=True)
class ScanResult:
    """Everything that was found, and what could not be examined."""

    found: tuple[FoundThing, ...]
    faults: tuple[str, ...]


def scan(machine: Machine, library: Library) -> ScanResult:
    """Examine everything; a bus that cannot be used is reported as a fault, and the others are still examined."""
    faults: list[str] = []
    found = [
        *_i2c(machine, library, faults),
        *_usb(machine),
        *_wire(machine),
        *_iio(machine, library),
        *_can(machine),
    ]
    return ScanResult(tuple(found), tuple(faults))


def _i2c(machine: Machine, library: Library, faults: list[str]) -> Iterator[FoundThing]:
    for path in _sorted(machine.path("/dev").glob("i2c-*")):
        number = path.name.removeprefix("i2c-")
        if not number.isdecimal():
            continue
        try:
            bus = machine.open_i2c(int(number))
        except HardwareFault as fault:
            faults.append(str(fault))
            continue
        try:
            yield from _chips(machine, library, bus, int(number))
        except OSError as error:
            faults.append(
                f"I2C bus {number} is stuck ({error.strerror or error}): something holds SDA or SCL low, or the "
                "pull-up resistors are missing"
            )
        finally:
            bus.close()


def _chips(machine: Machine, library: Library, bus: SmBus, number: int) -> Iterator[FoundThing]:
    for address in range(FIRST, LAST + 1):
        answer = _probe(bus, address)
        if answer is None:
            continue
        where = f"I2C bus {number}, address 0x{address:02x}"
        if not answer:
            name = machine.path(f"/sys/bus/i2c/devices/{number}-{address:04x}/name")
            owner = name.read_text().strip() if name.exists() else "one"
            yield FoundThing("i2c", where, f"in use by a driver of the kernel ({owner})", ())
            continue
        likely = [one for one in library if address in one.driver.addresses and one.driver.bus is BusKind.I2C]
        words = " or ".join(f"{one.name} ({one.number})" for one in likely) or "nothing that the library knows"
        if address == VL53L0X_ADDRESS and "VL53L0X" in library.numbers():
            words += " or a VL53L0X, which needs the kernel's driver"
        lines = tuple(f"msbot part {one.number} --i2c {number}:0x{address:02x}" for one in likely)
        yield FoundThing("i2c", where, words, lines)


def _probe(bus: SmBus, address: int) -> bool | None:
    """Whether a chip answers; False: the kernel is using it, None: no chip answers.

    Raises:
        OSError: the bus is stuck.
    """
    try:
        if any(address in addresses for addresses in READ_ONLY):
            bus.read_byte(address)
        else:
            bus.write_quick(address)
    except OSError as error:
        if error.errno == errno.EBUSY:
            return False
        if error.errno == errno.ETIMEDOUT:
            raise
        return None
    return True


def _usb(machine: Machine) -> Iterator[FoundThing]:
    for path in _sorted(machine.path("/sys/class/tty").glob("tty*")):
        device = _usb_device(path / "device")
        if device is None:
            continue
        vendor, product = (_text(device / name).lower() for name in ("idVendor", "idProduct"))
        name = " ".join(filter(None, (_text(device / "manufacturer"), _text(device / "product")))) or "a serial port"
        port = f"/dev/{path.name}"
        where = f"{port}, USB {vendor}:{product}"
        if vendor == NUMATO:
            words, line = f"{name}: USB module with inputs and outputs", f"msbot part NUMATO-8 --device {port}"
        elif (vendor, product) in SLCAN:
            words, line = f"{name}: CAN adapter (slcan)", f"msbot master --link can:slcan:{port}"
        elif vendor in BOARDS:
            words, line = f"{name}: {BOARDS[vendor]}", f"msbot master --link serial:{port}"
        else:
            words, line = name, f"msbot master --link serial:{port}"
        yield FoundThing("usb", where, words, (line,))


def _usb_device(path: Path) -> Path | None:
    """The USB device that an interface belongs to, a few folders up."""
    if not path.exists():
        return None
    place = path.resolve()
    for folder in (place, *list(place.parents)[:4]):
        if (folder / "idVendor").exists():
            return folder
    return None


def _wire(machine: Machine) -> Iterator[FoundThing]:
    for path in _sorted(machine.path(W1).glob("*-*")):
        if re.fullmatch(r"28-[0-9a-f]+", path.name):
            line = f"msbot part DS18B20 --device {path.name}"
            yield FoundThing("1-wire", path.name, "Waterproof temperature sensor (DS18B20)", (line,))
        elif re.fullmatch(r"[0-9a-f]{2}-[0-9a-f]+", path.name):
            yield FoundThing("1-wire", path.name, f"a 1-Wire device of family {path.name[:2]}", ())


def _iio(machine: Machine, library: Library) -> Iterator[FoundThing]:
    sensors = {one.driver.device: one for one in library if one.driver.bus is BusKind.KERNEL and one.driver.device}
    for path in _sorted(machine.path(IIO).glob("iio:device*")):
        name = _text(path / "name")
        number = path.name.removeprefix("iio:device")
        sensor = next((one for device, one in sensors.items() if name.startswith(device)), None)
        if sensor is not None:
            yield FoundThing(
                "sensor",
                path.name,
                f"{sensor.name} ({sensor.number})",
                (f"msbot part {sensor.number} --device {path.name}",),
            )
            continue
        channels = sorted(
            int(found[1])
            for entry in path.glob("in_voltage*_raw")
            if (found := re.fullmatch(r"in_voltage(\d+)_raw", entry.name))
        )
        if channels:
            words = f"converter {name or 'without a name'}, {amount(len(channels), 'channel')}"
            lines = tuple(f"msbot part POT-10K --adc out={number}:{channel}" for channel in channels[:1])
            yield FoundThing("converter", path.name, words, lines)


def _can(machine: Machine) -> Iterator[FoundThing]:
    for path in _sorted(machine.path("/sys/class/net").glob("*")):
        if _text(path / "type") != str(ARPHRD_CAN):
            continue
        state = _text(path / "operstate") or "unknown"
        words = f"CAN interface, {state}"
        up = () if state in ("up", "unknown") else (f"sudo ip link set {path.name} up type can bitrate 500000",)
        yield FoundThing("can", path.name, words, (*up, f"msbot master --link can:{path.name}"))


def _text(path: Path) -> str:
    """The text of a file; empty if it cannot be read."""
    try:
        return path.read_text("utf-8", "replace").strip()[:200]
    except OSError:
        return ""


def _sorted(paths: Iterable[Path]) -> list[Path]:
    return sorted(paths, key=lambda path: (len(path.name), path.name))[:MOST_ENTRIES]
