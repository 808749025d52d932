"""Pins of a real kernel: `gpio-sim` is a chip of 28 GPIO lines, which the drivers switch and read through gpiozero,
lgpio and /dev/gpiochip0 as on a Raspberry Pi. What is wired to a line is seen and done at its files in /sys; what
happens to a line when its program is killed, the kernel tells whoever watches it.

The programs are copies of this process, made by `fork`: where this runs, loading Python's modules takes seconds."""

from __future__ import annotations

import fcntl
import json
import os
import select
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

import pytest

from msbot.hardware import Driver, Machine, Mount, Values, driver_class, make_wiring
from msbot.hardware.output_guard import as_json, keep
from tests.sim.robot import LIBRARY
from tests.socketcan.bus import PATIENCE_S
from tests.socketcan.kernel_modules import load, load_built

pytestmark = [
    pytest.mark.controllers,
    pytest.mark.skipif(find_spec("lgpio") is None, reason="lgpio is not installed: pip install 'msbot[hardware]'"),
]
LINES = 28
CHIP = Path("/dev/gpiochip0")
RASPBERRY_PI_4 = "Revision : c03111\n"
"""What gpiozero looks for in /proc/cpuinfo."""
RELAY, LAMP, BUTTON = 17, 18, 22
WATCH = 0xC100B406
"""GPIO_V2_GET_LINEINFO_WATCH_IOCTL of linux/gpio.h, for a `gpio_v2_line_info` of 256 octets."""
CHANGED = struct.Struct("=32s32sIIQ176xQI20x")
"""`gpio_v2_line_info_changed`: name, consumer, offset, number of attributes, flags, ..., time, event."""
EVENTS = {1: "taken", 2: "released", 3: "changed"}
OUTPUT = 1 << 3
"""GPIO_V2_LINE_FLAG_OUTPUT."""


class Wire:
    """What is wired to one line."""

    def __init__(self, line: int) -> None:
        (self._folder,) = Path("/sys/devices/platform").glob(f"gpio-sim.*/gpiochip*/sim_gpio{line}")

    @property
    def level(self) -> bool:
        return (self._folder / "value").read_text().strip() == "1"

    def pull(self, *, up: bool) -> None:
        (self._folder / "pull").write_text("pull-up" if up else "pull-down")


class Watch:
    """What the kernel says about who has a line."""

    def __init__(self, line: int) -> None:
        self._file = os.open(CHIP, os.O_RDONLY | os.O_CLOEXEC)
        fcntl.ioctl(self._file, WATCH, bytearray(struct.pack("=64xI188x", line)))

    def events(self) -> list[str]:
        """What has happened since the last call."""
        found = []
        while select.select([self._file], [], [], 0)[0]:
            _, _, _, _, flags, _, event = CHANGED.unpack(os.read(self._file, CHANGED.size))
            found.append(f"{EVENTS[event]}{' as output' if flags & OUTPUT else ''}")
        return found

    def close(self) -> None:
        os.close(self._file)


@pytest.fixture
def pi(tmp_path: Path) -> Iterator[None]:
    """The kernel has a chip of GPIO lines, and says that it is a Raspberry Pi."""
    load("configfs")
    load_built("gpio_sim")
    subprocess.run(["mount", "-t", "configfs", "none", "/sys/kernel/config"], check=True)
    chip = Path("/sys/kernel/config/gpio-sim/pi")
    bank = chip / "bank"
    bank.mkdir(parents=True)
    (bank / "num_lines").write_text(str(LINES))
    (chip / "live").write_text("1")
    (tmp_path / "cpuinfo").write_text(RASPBERRY_PI_4)
    subprocess.run(["mount", "--bind", str(tmp_path / "cpuinfo"), "/proc/cpuinfo"], check=True)
    yield
    subprocess.run(["umount", "/proc/cpuinfo"], check=True)
    (chip / "live").write_text("0")
    bank.rmdir()
    chip.rmdir()
    subprocess.run(["umount", "/sys/kernel/config"], check=True)


@contextmanager
def program(main: Callable[[], object]) -> Iterator[int]:
    """A process of its own that does something; it is killed at the end, if it is still there."""
    process = os.fork()
    if process == 0:
        status = 1
        try:
            main()
            status = 0
        finally:
            os._exit(status)
    try:
        yield process
    finally:
        if process not in ended:
            os.kill(process, signal.SIGKILL)
            wait(process)


ended: dict[int, int] = {}


def wait(process: int) -> int:
    """Wait for the end of a process; its exit status, or minus the signal that ended it."""
    ended[process] = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
    return ended[process]


def until(condition: Callable[[], object]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def driver(number: str, gpio: int, changed: Callable[[Values], None] = lambda _: None) -> Driver:
    part_type = LIBRARY.require(number)
    wiring = make_wiring(part_type, pins={"s": gpio})
    made = driver_class(part_type)(Mount(part_type, wiring, Machine(keeper=[]), changed))
    made.open()
    return made


def held(number: str, gpio: int) -> bytes:
    """What the keeper is told when that driver is opened."""
    part_type = LIBRARY.require(number)
    wiring = as_json(make_wiring(part_type, pins={"s": gpio}))
    line = {"hold": number, "class": part_type.driver.entry_point, "number": number, "source": part_type.source}
    return json.dumps(line | {"wiring": wiring}).encode() + b"\n"


def test_pins_of_the_kernel_are_switched_and_read_and_none_stays_on_when_the_program_is_killed(
    pi: None, tmp_path: Path
) -> None:
    import gpiozero  # noqa: F401  # once, for both programs

    relay, lamp, button, watch = Wire(RELAY), Wire(LAMP), Wire(BUTTON), Watch(RELAY)
    told, tell = os.pipe()  # to the program
    keeper_told, tell_keeper = os.pipe()
    seen = tmp_path / "seen"
    seen.touch()

    def switch() -> None:
        """Drives the relay, half of the lamp, and says what the button does; ends only when it is killed."""
        coil, light = driver("RELAY-1", RELAY), driver("LED", LAMP)
        with seen.open("w", buffering=1) as file:
            push = driver("BUTTON", BUTTON, lambda values: print("changed", dict(values), file=file))
            print("read", push.sample({}), file=file)
            os.read(told, 1)
            coil.drive(True)
            light.drive(0.5)
            os.read(told, 1)
            light.drive(1.0)
            while True:
                signal.pause()

    def watch_over() -> None:
        """The keeper."""
        os.close(tell_keeper)
        faults = keep(os.fdopen(keeper_told, "rb"), Machine(keeper=[]))
        if faults:
            sys.exit(str(faults))

    with program(watch_over) as keeper, program(switch) as driving:
        os.close(keeper_told)
        os.write(tell_keeper, held("RELAY-1", RELAY) + held("LED", LAMP))
        os.close(tell_keeper)  # now the program alone has this end, and the system closes it when the program dies
        until(seen.read_text)
        assert not relay.level
        assert not lamp.level
        button.pull(up=True)
        until(lambda: "changed {'press': True}" in seen.read_text())
        button.pull(up=False)
        until(lambda: "changed {'press': False}" in seen.read_text())
        os.write(tell, b"x")
        until(lambda: relay.level and lamp.level)
        until(lambda: not lamp.level)  # PWM
        os.write(tell, b"x")
        until(lambda: relay.level and all(lamp.level for _ in range(100)))
        assert watch.events()[-1] == "taken as output"
        os.kill(driving, signal.SIGKILL)
        assert wait(driving) == -signal.SIGKILL
        assert not relay.level, "the kernel has released the line, and this chip goes back to the pull of its resistor"
        assert not lamp.level
        assert wait(keeper) == 0
        events = watch.events()
        assert events[0].startswith("released"), "by the kernel, from the program that was killed"
        assert "taken as output" in events[1:], "by the keeper, whose drivers begin with the safe value"
        assert events[-1].startswith("released"), events
        assert not relay.level
        assert not lamp.level
    watch.close()
    for end in (told, tell):
        os.close(end)
