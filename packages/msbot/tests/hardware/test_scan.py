"""What a scan finds, in a tree of files as Linux makes it and on buses of models."""

from __future__ import annotations

import errno
import json
from pathlib import Path

import pytest
from click.testing import CliRunner

import msbot.cli.run.host
from msbot.hardware import FoundThing, HardwareFault, Machine, ScanResult, scan
from tests.hardware.chips import Bus, Chip, bmp280
from tests.sim.robot import LIBRARY


def machine(root: Path, **buses: Bus | HardwareFault) -> Machine:
    """A computer with these buses: `bus_1`."""
    (root / "dev").mkdir(exist_ok=True)
    for name in buses:
        (root / "dev" / name.replace("bus_", "i2c-")).touch()

    def open_i2c(number: int) -> Bus:
        bus = buses[f"bus_{number}"]
        if isinstance(bus, HardwareFault):
            raise bus
        return bus

    return Machine(root=root, open_i2c=open_i2c, keeper=[])


def write(path: Path, **files: str) -> None:
    path.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (path / name).write_text(f"{text}\n")


def test_chips_are_told_by_their_addresses(tmp_path: Path) -> None:
    bus = Bus(at_76=bmp280(), at_29=Chip(), at_50=Chip(), at_68=Chip())
    result = scan(machine(tmp_path, bus_1=bus), LIBRARY)
    assert [(thing.where, thing.lines) for thing in result.found] == [
        ("I2C bus 1, address 0x29", ("msbot part TCS34725 --i2c 1:0x29",)),
        ("I2C bus 1, address 0x50", ()),
        ("I2C bus 1, address 0x68", ("msbot part MPU-6050 --i2c 1:0x68",)),
        ("I2C bus 1, address 0x76", ("msbot part BMP280 --i2c 1:0x76",)),
    ]
    assert "or a VL53L0X, which needs the kernel's driver" in result.found[0].words
    assert result.found[1].words == "nothing that the library knows"
    assert not bus.is_open
    assert bus.chips[0x76].written == [], "nothing is written into a chip"


class Busy(Bus):
    """A chip that a driver of the kernel has."""

    def write_quick(self, i2c_addr: int) -> None:
        if i2c_addr == 0x29:
            raise OSError(errno.EBUSY, "Device or resource busy")
        super().write_quick(i2c_addr)


def test_a_chip_that_the_kernel_has_is_said_to_be_its(tmp_path: Path) -> None:
    write(tmp_path / "sys/bus/i2c/devices/1-0029", name="vl53l0x")
    result = scan(machine(tmp_path, bus_1=Busy()), LIBRARY)
    assert result.found == (
        FoundThing("i2c", "I2C bus 1, address 0x29", "in use by a driver of the kernel (vl53l0x)", ()),
    )


def test_a_bus_that_cannot_be_used_does_not_hide_the_others(tmp_path: Path) -> None:
    stuck = Bus(at_10=Chip())
    stuck.stuck = True
    result = scan(
        machine(tmp_path, bus_0=HardwareFault("no permission"), bus_1=stuck, bus_10=Bus(at_76=bmp280())), LIBRARY
    )
    assert result.faults[0] == "no permission"
    assert "I2C bus 1 is stuck" in result.faults[1]
    assert [thing.where for thing in result.found] == ["I2C bus 10, address 0x76"]


@pytest.mark.parametrize(
    ("vendor", "product", "line"),
    [
        ("2a19", "0800", "msbot part NUMATO-8 --device /dev/ttyACM0"),
        ("ad50", "60c4", "msbot master --link can:slcan:/dev/ttyACM0"),
        ("2e8a", "0005", "msbot master --link serial:/dev/ttyACM0"),
        ("0403", "6001", "msbot master --link serial:/dev/ttyACM0"),
    ],
)
def test_usb_devices_are_told_by_vendor_and_product(vendor: str, product: str, line: str, tmp_path: Path) -> None:
    device = tmp_path / "sys/devices/usb1/1-1"
    write(device, idVendor=vendor, idProduct=product, product="Thing")
    (device / "1-1:1.0").mkdir()
    write(tmp_path / "sys/class/tty/ttyACM0")
    (tmp_path / "sys/class/tty/ttyACM0/device").symlink_to(device / "1-1:1.0")
    write(tmp_path / "sys/class/tty/tty1")  # a console: no device
    (thing,) = scan(machine(tmp_path), LIBRARY).found
    assert thing.lines == (line,)
    assert thing.where == f"/dev/ttyACM0, USB {vendor}:{product}"


def test_thermometers_converters_sensors_and_can(tmp_path: Path) -> None:
    for name in ("28-0316a2795eff", "10-000801b5a7a6", "w1_bus_master1", "00-400000000000"):
        write(tmp_path / "sys/bus/w1/devices" / name)
    write(tmp_path / "sys/bus/iio/devices/iio:device0", name="mcp3008", in_voltage0_raw="1", in_voltage7_raw="1")
    write(tmp_path / "sys/bus/iio/devices/iio:device1", name="dht11@4", in_temp_input="1")
    write(tmp_path / "sys/bus/iio/devices/iio:device2", name="accel")
    write(tmp_path / "sys/class/net/lo", type="772")
    write(tmp_path / "sys/class/net/can0", type="280", operstate="down")
    write(tmp_path / "sys/class/net/vcan0", type="280", operstate="unknown")
    found = {thing.where: thing for thing in scan(machine(tmp_path), LIBRARY).found}
    assert {where: thing.lines for where, thing in found.items()} == {
        "00-400000000000": (),
        "10-000801b5a7a6": (),
        "28-0316a2795eff": ("msbot part DS18B20 --device 28-0316a2795eff",),
        "iio:device0": ("msbot part POT-10K --adc out=0:0",),
        "iio:device1": ("msbot part DHT22 --device iio:device1",),
        "can0": ("sudo ip link set can0 up type can bitrate 500000", "msbot master --link can:can0"),
        "vcan0": ("msbot master --link can:vcan0",),
    }
    assert found["iio:device0"].words == "converter mcp3008, 2 channels"


def test_an_empty_computer(tmp_path: Path) -> None:
    assert scan(machine(tmp_path), LIBRARY) == ScanResult((), ())


def test_every_line_that_makes_a_part_is_one_that_works(tmp_path: Path) -> None:
    from msbot.hardware import make_wiring

    chips = {f"at_{address:02x}": Chip() for one in LIBRARY for address in one.driver.addresses}
    found = scan(machine(tmp_path, bus_1=Bus(**chips)), LIBRARY).found
    lines = [line.split() for thing in found for line in thing.lines]
    assert len(lines) > 30
    for _, _, number, option, place in lines:
        assert option == "--i2c"
        assert make_wiring(LIBRARY.require(number), i2c=place).i2c is not None


def test_the_command_tells_it_in_words_and_as_json(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    computer = machine(tmp_path, bus_1=Bus(at_76=bmp280()), bus_2=HardwareFault("no permission for /dev/i2c-2"))
    monkeypatch.setattr("msbot.hardware.Machine", lambda: computer)
    words = CliRunner().invoke(msbot.cli.run.host.hardware_command, ["scan"])
    assert words.exit_code == 1
    assert "I2C bus 1, address 0x76: Air pressure sensor (BMP280)\n    msbot part BMP280 --i2c 1:0x76\n" in words.output
    assert "no permission for /dev/i2c-2" in words.output
    told = json.loads(CliRunner().invoke(msbot.cli.run.host.hardware_command, ["scan", "--json"]).output)
    assert told["found"][0]["lines"] == ["msbot part BMP280 --i2c 1:0x76"]
    assert told["faults"] == ["no permission for /dev/i2c-2"]
