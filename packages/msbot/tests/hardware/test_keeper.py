"""However a program dies, no output stays on: a small process makes safe what it held."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from msbot.config import BusKind
from msbot.hardware import Machine, make_wiring
from msbot.hardware import driver_class as driver_class_of
from msbot.hardware.drivers.strip import frame
from msbot.hardware.output_guard import OutputGuard, as_json, keep
from tests.sim.robot import LIBRARY

LED = LIBRARY.require("LED")
PATIENCE_S = 60

PINS = '''
import sys
from pathlib import Path
from gpiozero import Device
from gpiozero.pins.mock import MockFactory, MockPWMPin

class Pin(MockPWMPin):
    """A pin whose level outlives the program, as that of a real one does."""
    def _change_state(self, value):
        with (Path(sys.argv[1]) / self.info.name).open("a") as file:
            file.write(f"{float(value)}\\n")
        return super()._change_state(value)
    def close(self):
        pass  # the worst that a computer can do: a pin that is let go stays as it is

Device.pin_factory = MockFactory(pin_class=Pin)
'''
KEEPER = PINS + "from msbot.hardware.output_guard import main\nmain()\n"
PROGRAM = (
    PINS
    + """
import time
from msbot.config import load_library
from msbot.hardware import Machine, Mount, make_wiring, driver_class
from msbot.hardware.output_guard import OutputGuard
led = load_library().require("LED")
keeper = OutputGuard([sys.executable, sys.argv[2], sys.argv[1]])
driver = driver_class(led)(Mount(led, make_wiring(led), Machine()))
keeper.hold("LED", led, make_wiring(led))
driver.open()
driver.drive(1.0)
print("on", flush=True)
time.sleep(1000)
"""
)

ALL_DRIVERS = (
    PINS
    + """
import json, time
from collections import defaultdict
from msbot.config import load_library
from msbot.hardware import Machine, Mount, make_wiring, driver_class
from msbot.hardware.output_guard import OutputGuard
keeper = OutputGuard([sys.executable, sys.argv[2], sys.argv[1]])
library = load_library()
for number, (pins, device) in json.loads(sys.argv[3]).items():
    part_type = library.require(number)
    wiring = make_wiring(part_type, pins=pins, device=device)
    driver = driver_class(part_type)(Mount(part_type, wiring, Machine()))
    keeper.hold(number, part_type, wiring)
    driver.open()
    driver.drive(driver.outputs_for(defaultdict(lambda: 90.0)))
print("on", flush=True)
time.sleep(1000)
"""
)
"""A program with every driver that switches pins, each on."""


def held(key: str, gpio: int) -> bytes:
    wiring = as_json(make_wiring(LED, pins=f"s={gpio}"))
    line = {"hold": key, "class": LED.driver.entry_point, "number": "LED", "source": LED.source, "wiring": wiring}
    return json.dumps(line).encode()


class Watched(list[tuple[str, float]]):
    """Levels that a pin had, as they came."""


@pytest.fixture
def levels(pins: Any, monkeypatch: pytest.MonkeyPatch) -> Watched:
    seen = Watched()
    original = pins.pin_class._change_state

    def change(self: Any, value: float) -> bool:
        seen.append((self.info.name, value))
        changed: bool = original(self, value)
        return changed

    monkeypatch.setattr(pins.pin_class, "_change_state", change)
    return seen


def test_what_is_still_held_is_made_safe_and_what_was_let_go_is_not_touched(levels: Watched) -> None:
    lines = [held("a", 17), held("b", 27), b'{"free": "b"}']
    assert keep(lines, Machine(keeper=[]), wait=lambda _: None) == []
    assert {name for name, _ in levels} == {"GPIO17"}
    assert levels[-1] == ("GPIO17", 0.0)


def test_what_cannot_be_made_safe_is_told(pins: Any) -> None:
    from gpiozero import LED as Lamp

    lamp = Lamp(17)
    waited: list[float] = []
    (fault,) = keep([held("a", 17)], Machine(keeper=[]), wait=waited.append)
    assert fault.startswith("a: GPIO 17 is used twice")
    assert len(waited) == 20, "it is tried for two seconds"
    lamp.close()


def until(condition: Callable[[], object]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.fixture
def program(tmp_path: Path) -> Iterator[tuple[subprocess.Popen[str], Path]]:
    """A program that has switched a lamp on; its pins are files that outlive it."""
    (tmp_path / "pins").mkdir()
    (tmp_path / "keeper.py").write_text(KEEPER)
    (tmp_path / "program.py").write_text(PROGRAM)
    command = [sys.executable, str(tmp_path / "program.py"), str(tmp_path / "pins"), str(tmp_path / "keeper.py")]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "on\n"
    yield process, tmp_path / "pins" / "GPIO17"
    process.kill()
    process.wait()
    process.stdout.close()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, signal.SIGSEGV])
def test_no_output_stays_on_however_a_program_is_killed(
    number: signal.Signals, program: tuple[subprocess.Popen[str], Path]
) -> None:
    process, pin = program
    until(lambda: pin.read_text().split()[-1] == "1.0")
    os.kill(process.pid, number)
    process.wait(PATIENCE_S)
    until(lambda: pin.read_text().split()[-1] == "0.0")


def test_every_driver_with_outputs_is_made_safe_when_its_program_is_killed(tmp_path: Path) -> None:
    wired = [one for one in LIBRARY if one.driver.bus is BusKind.PINS and one.driver.entry_point]
    switching = [one for one in wired if driver_class_of(one).drives]
    assert len(switching) == 13
    free = iter(range(28))  # all that a Raspberry Pi has
    places = {one.number: ({wire.name: next(free) for wire in one.driver.pins}, "") for one in switching}
    strip = tmp_path / "spi"
    strip.touch()
    places["WS2812B-8"] = ({}, str(strip))
    folder = tmp_path / "pins"
    folder.mkdir()
    (tmp_path / "keeper.py").write_text(KEEPER)
    (tmp_path / "program.py").write_text(ALL_DRIVERS)
    command = [sys.executable, str(tmp_path / "program.py"), str(folder), str(tmp_path / "keeper.py")]
    process = subprocess.Popen([*command, json.dumps(places)], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "on\n"
        until(lambda: switched(folder, places) == {*places} - {"WS2812B-8"})
        until(lambda: second(strip) == frame([(90, 90, 90)] * 8)[:72])
    finally:
        process.kill()
        process.wait(PATIENCE_S)
        assert process.stdout is not None
        process.stdout.close()
    gpios = [pin for pins, _ in places.values() for pin in pins.values()]
    until(lambda: not any(float(levels_of(folder, pin)[-1]) for pin in gpios))
    until(lambda: second(strip) == frame([(0, 0, 0)] * 8)[:72])


def switched(folder: Path, places: dict[str, tuple[dict[str, int], str]]) -> set[str]:
    """The parts that have switched a pin on by now; some do that in a thread of their own."""
    return {
        number
        for number, (pins, _) in places.items()
        if any(float(level) for pin in pins.values() for level in levels_of(folder, pin))
    }


def second(strip: Path) -> bytes:
    """The lamps of the second message in a file that stands for an SPI: the first is that of `open`, and dark."""
    size = len(frame([(0, 0, 0)] * 8))
    return strip.read_bytes()[size : size + 72]


def levels_of(folder: Path, pin: int) -> list[str]:
    """The levels that a pin had."""
    path = folder / f"GPIO{pin}"
    return path.read_text().split() if path.exists() else ["0.0"]


def test_a_keeper_ends_with_its_program_and_without_one_nothing_is_started(tmp_path: Path) -> None:
    keeper = OutputGuard(
        [
            sys.executable,
            "-c",
            "import sys; open(sys.argv[1], 'wb').write(sys.stdin.buffer.read())",
            str(tmp_path / "said"),
        ]
    )
    keeper.end()
    assert not (tmp_path / "said").exists()
    keeper.hold("a", LED, make_wiring(LED))
    keeper.free("a")
    keeper.end()
    first, second = (tmp_path / "said").read_text().splitlines()
    assert json.loads(first)["hold"] == "a"
    assert json.loads(second) == {"free": "a"}


def test_the_process_that_is_started_says_nothing_when_there_is_nothing_to_make_safe() -> None:
    done = subprocess.run(Machine().keeper, input=b"", capture_output=True, check=True)
    assert (done.stdout, done.stderr) == (b"", b"")


@pytest.mark.skipif(find_spec("lgpio") is None, reason="lgpio is not installed: pip install 'msbot[hardware]'")
def test_the_pin_library_leaves_nothing_in_the_current_folder_and_needs_no_right_to_write_there(tmp_path: Path) -> None:
    program = (
        "import os, sys; from msbot.hardware.pins import import_lgpio; os.chdir(sys.argv[1]); "
        "import_lgpio(); assert 'lgpio' in sys.modules; print(os.getcwd())"
    )
    done = subprocess.run([sys.executable, "-c", program, tmp_path], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == (f"{tmp_path}\n", "")
    assert list(tmp_path.iterdir()) == []
