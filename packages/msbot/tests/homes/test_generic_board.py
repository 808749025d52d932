"""A generic board in its robot: what is wired to it comes from the master, changes while it runs, and survives a power
cut; in the real MicroPython VM and in its double, over CAN and over a serial line."""

from __future__ import annotations

import asyncio
import importlib.util
import os
import sys
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from msbot import Distance, Level, Pressure, Switch, Temperature, Text
from msbot_xrce.errors import ConfigError
from tests.homes import micro
from tests.homes.board_world import FAKES, HOSTS, BoardHome, BoardWorld
from tests.homes.runners import NODE, DoubleEngine, NodeEngine, as_micropython
from tests.homes.world import PARTNER_UID, SLOT, UID, run_virtual, uid_on_board
from tools.stored_by import STORED, WIRED

NEEDED = "MSBOT_NEED_NODE"
BMP280 = [
    [0xD0, "58"],
    [0x88, "706b4367 18fc7d8e43d6d00b270b8c00f9ff8c3cf8c67017".replace(" ", "")],
    [0xF7, "655ac07eed00"],
]
"""Bosch BST-BMP280-DS001-19, section 3.12: 25.08 degrees, 1006.53 hPa."""
PARTS = {
    "eye": "HC-SR04",
    "lamp": "LED",
    "arm": "SG90",
    "air": "BMP280",
    "bumper": "BUTTON",
    "knob": "POT-10K",
    "wheels": "TB6612FNG",
    "relay": "RELAY-1",
}
EYE = "HC-SR04 eye: trigger=5, echo=18"
LAMP = "LED lamp: s=2"
ARM = "SG90 arm: pwm=13"
AIR = "BMP280 air: scl=22, sda=21"
ALL = (
    EYE,
    LAMP,
    ARM,
    AIR,
    "BUTTON bumper: s=4, pull=up, active_low=true",
    "POT-10K knob: out=34",
    "TB6612FNG wheels: pwma=14, ain1=26, ain2=27, pwmb=15, bin1=32, bin2=33",
    "RELAY-1 relay: s=12, active_low=true",
)
FULL = 65535
STORED_FILES = sorted(STORED.glob("*/board/parts.json"))
"""What each version of MsBOT on a board has kept of its parts."""


def test_each_version_has_kept_a_file() -> None:
    assert len(STORED_FILES) == len([*STORED.iterdir()])


def fake_machine() -> ModuleType:
    """A fresh one."""
    spec = importlib.util.spec_from_file_location("machine", Path(__file__).parent / "fake_machine.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def on(*engines: str) -> pytest.MarkDecorator:
    """Where a test runs: in the VM each octet is carried between two processes, which takes its time."""
    return pytest.mark.parametrize("make", engines, indirect=True)


@pytest.fixture
def make(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Iterator[Callable[..., BoardHome]]:
    engine, _, link = request.param.partition("-")
    if engine == "vm" and NODE is None:
        (pytest.fail if os.environ.get(NEEDED) else pytest.skip)("there is no node here for the MicroPython VM")
    monkeypatch.chdir(tmp_path)

    def start(files: dict[str, str] | None = None, key: bytes | None = None) -> BoardHome:
        if engine == "vm":
            return BoardHome(NodeEngine(micro.FOLDER, *FAKES), link, files, key)
        monkeypatch.setitem(sys.modules, "machine", fake_machine())
        monkeypatch.setattr("time.sleep_ms", lambda _: None, raising=False)
        monkeypatch.setattr("time.sleep_us", lambda _: None, raising=False)
        return BoardHome(DoubleEngine(*HOSTS), link, files, key)

    yield start
    micro.forget()


def play(
    home: BoardHome,
    story: Callable[[BoardWorld], Awaitable[None]],
    wired: tuple[str, ...] = ALL,
    keys: dict[bytes, bytes] | None = None,
    authentication: str = "key",
    parts: dict[str, str] = PARTS,
) -> BoardWorld:
    async def main() -> BoardWorld:
        world = BoardWorld(home, parts, wired, keys, authentication)
        world.start_master()
        await world.master.ready.wait()
        try:
            world.plug_desk()
            await asyncio.sleep(1.0)
            await story(world)
        finally:
            await world.close()
        return world

    with as_micropython():
        return run_virtual(main())


def looker(world: BoardWorld) -> Callable[[int], list[Any]]:
    """What can be seen of a pin of the board: whether it is an output, and its level or duty cycle."""
    return lambda pin: list(world.board.machine("look", pin))


async def begin(world: BoardWorld, *slots: str) -> None:
    """The board is plugged in with its chip and its button, and the slots have their parts."""
    world.plug()
    world.board.machine("set_echo", 5831)
    world.board.machine("plug", 0x76, BMP280)
    world.board.machine("set_volts", 34, 1.65)
    await world.until(**dict.fromkeys((SLOT, *(slots or PARTS)), "active"))
    await asyncio.sleep(1.0)


@on("double-can", "vm-serial")
def test_a_stop_button_at_a_board_stops_the_robot(make: Callable[..., BoardHome]) -> None:
    async def story(world: BoardWorld) -> None:
        world.plug()
        world.board.machine("drive", 4, 0)
        await world.until(button="active")
        await asyncio.sleep(1.0)
        assert not world.master.stop.stopped
        world.board.machine("drive", 4, 1)
        await asyncio.sleep(1.5)
        assert world.master.stop.by == "button"
        assert not world.master.stop.silent
        with pytest.raises(ConfigError, match="release the STOP button"):
            world.master.say_go("ann")
        world.board.machine("drive", 4, 0)
        await asyncio.sleep(1.0)
        assert world.master.stop.stopped
        world.master.say_go("ann")
        await asyncio.sleep(2.0)
        assert world.master.stop.number == 1

    play(make(), story, ("ESTOP button: s=4",), parts={"button": "ESTOP"})


@on("double-can", "vm-serial")
def test_eight_parts_measure_and_are_driven(make: Callable[..., BoardHome]) -> None:
    async def story(world: BoardWorld) -> None:
        await begin(world)
        look = looker(world)
        natures = {info.slot: info.nature.label for info in world.master.inventory.view(0.0)}
        assert natures == {slot: "real" for slot in (SLOT, *PARTS)} | {"partner": ""}
        distance = world.heard["eye/distance"][-1]
        assert isinstance(distance, Distance)
        assert (round(distance.metres, 3), distance.in_range) == (0.999, True)
        pressure, temperature = world.heard["air/pressure"][-1], world.heard["air/temperature"][-1]
        assert isinstance(pressure, Pressure)
        assert isinstance(temperature, Temperature)
        assert round(pressure.hectopascal, 1) == 1006.5
        assert round(temperature.celsius, 2) == 25.08
        level = world.heard["knob/level"][-1]
        assert isinstance(level, Level)
        assert round(level.percent, 1) == 50.0

        def pressed() -> list[bool]:
            return [one.on for one in world.heard["bumper/pressed"] if isinstance(one, Switch)]

        assert pressed()[-1] is False
        for level_of_pin in (0, 1, 0, 1):  # twice, shorter than the board looks
            world.board.machine("drive", 4, level_of_pin)
        await asyncio.sleep(0.5)
        assert pressed()[-5:] == [False, True, False, True, False]
        # Before any command: safe values. The relay is switched on by a low pin.
        assert look(2) == ["out", 0]
        assert look(12) == ["out", 1]
        assert look(13) == ["out", round((0.5 + 0.5 * 1.9) / 20 * FULL)]
        world.send("lamp/on", on=True)
        world.send("relay/on", on=True)
        world.send("arm/angle", degrees=180.0)
        world.send("wheels/left", percent=50.0)
        world.send("wheels/right", percent=-100.0)
        await asyncio.sleep(2.0)
        assert look(2) == ["out", FULL]
        assert look(12) == ["out", 0]
        assert look(13) == ["out", round(2.4 / 20 * FULL)]
        assert [look(pin)[1] for pin in (14, 26, 27)] == [round(FULL / 2), 1, 0]
        assert [look(pin)[1] for pin in (15, 32, 33)] == [FULL, 0, 1]
        world.change("arm", {"max_angle": "90", "angle.safe.degrees": "0"})
        world.change("lamp", {"brightness": "25"})
        await asyncio.sleep(1.0)
        assert look(13)[1] == round((0.5 + 0.5 * 1.9) / 20 * FULL)
        assert look(2)[1] == round(FULL / 4)
        world.master.say_stop("ann")
        await asyncio.sleep(1.0)
        assert [look(pin)[1] for pin in (2, 12, 14, 26, 15, 33)] == [0, 1, 0, 0, 0, 0]
        assert look(13)[1] == round(0.5 / 20 * FULL), "the safe value of its slot"
        status = world.master.inventory_service.stop.status()
        assert not status.silent, status
        world.master.say_go("ann")
        world.send("lamp/on", on=True)
        await asyncio.sleep(1.0)
        await world.kill_master()
        await asyncio.sleep(10.0)
        assert look(2)[1] == 0

    play(make(), story)


@on("double-can", "double-serial")
def test_wiring_changes_while_it_runs_and_the_others_are_not_disturbed(make: Callable[..., BoardHome]) -> None:
    async def story(world: BoardWorld) -> None:
        await begin(world, "eye", "lamp")
        look = looker(world)
        world.send("lamp/on", on=True)
        await asyncio.sleep(0.5)
        assert look(2) == ["out", FULL]
        before = {info.slot: info.client_key for info in world.master.inventory.view(0.0)}
        world.wire((EYE, "LED lamp: s=19, active_low=true", ARM))
        await asyncio.sleep(0.1)
        await world.until(arm="active", lamp="active")
        await asyncio.sleep(0.5)
        assert look(2) == ["in", 0]
        assert look(19) == ["out", FULL]  # off: it shines when the pin is low
        world.send("lamp/on", on=True)
        await asyncio.sleep(0.5)
        assert look(19) == ["out", 0]
        after = {info.slot: info.client_key for info in world.master.inventory.view(0.0)}
        assert [slot for slot in before if after[slot] != before[slot]] == ["lamp"]
        world.wire((EYE,))
        await world.until(lamp="left", arm="left", eye="active")
        assert look(19)[0] == "in"

    play(make(), story, (EYE, LAMP))


@on("double-serial", "vm-can")
def test_a_board_remembers_through_a_power_cut_and_is_safe_before_it_joins(make: Callable[..., BoardHome]) -> None:
    home = make()
    kept: dict[str, str] = {}

    async def learn(world: BoardWorld) -> None:
        await begin(world, "lamp", "relay")
        kept.update(world.board.files())

    wired = (LAMP, "RELAY-1 relay: s=12, active_low=true")
    play(home, learn, wired)
    assert list(kept) == ["parts.json"]
    again = make(kept)

    async def wake(world: BoardWorld) -> None:
        await world.kill_master()
        world.plug()
        assert world.board.machine("look", 12) == ["out", 1]
        assert world.board.machine("look", 2) == ["out", 0]
        await asyncio.sleep(5.0)
        assert world.board.machine("look", 12) == ["out", 1]
        world.new_board_master()
        world.start_master()
        await world.until(mine="active", lamp="active", relay="active")

    play(again, wake, wired)


@on("double-serial", "vm-serial")
@pytest.mark.parametrize("stored", STORED_FILES, ids=lambda path: path.parts[-3])
def test_a_board_takes_up_what_an_earlier_version_kept(make: Callable[..., BoardHome], stored: Path) -> None:
    async def wake(world: BoardWorld) -> None:
        await world.kill_master()
        world.plug()
        assert world.board.machine("look", 12) == ["out", 1]  # the relay of tools/stored_by.py: off when high
        assert world.board.machine("look", 2) == ["out", 0]
        world.new_board_master()
        world.start_master()
        await world.until(mine="active", lamp="active", relay="active")
        assert not any("damaged" in line for line in world.log), world.log

    play(make({"parts.json": stored.read_text("utf-8")}), wake, tuple(WIRED.values()))


@on("double-serial", "vm-serial")
def test_a_damaged_file_is_not_used(make: Callable[..., BoardHome]) -> None:
    async def story(world: BoardWorld) -> None:
        await begin(world, "lamp")
        assert any("parts.json is damaged" in line for line in world.log), world.log
        assert world.board.files()["parts.json"].count("\n") == 1

    play(make({"parts.json": "00000000\n{}"}), story, (LAMP,))


@on("double-can")
def test_a_chip_that_is_pulled_out_is_lost_with_a_reason_and_comes_back(make: Callable[..., BoardHome]) -> None:
    async def story(world: BoardWorld) -> None:
        await begin(world, "lamp", "air")
        world.board.machine("pull", 0x76)
        await world.until(air="left", lamp="active")
        sentence = (
            "no BMP280 answers at 0x76 (scl at pin 22, sda at pin 21): check its supply, both wires, and its address"
        )
        assert sentence in world.master.why("air")[0]
        await asyncio.sleep(2.0)
        report = world.heard[f"{SLOT}/report"][-1]
        assert isinstance(report, Text)
        assert report.text == (
            "air: no BMP280 answers at 0x76 (scl at pin 22, sda at pin 21): check its supply, both wires, and its "
            "address"
        )
        world.board.machine("plug", 0x76, BMP280)
        await world.until(air="active")
        await asyncio.sleep(2.0)
        assert world.heard[f"{SLOT}/report"][-1] == Text(text="")

    play(make(), story, (LAMP, AIR))


@on("double-can")
def test_ctrl_c_ends_all_parts_with_outputs_off(make: Callable[..., BoardHome]) -> None:
    async def story(world: BoardWorld) -> None:
        await begin(world, "lamp", "eye")
        world.send("lamp/on", on=True)
        await asyncio.sleep(0.5)
        world.board.end()
        assert world.board.machine("look", 2) == ["in", 0]
        await world.until(lamp="left", eye="left", mine="left")

    play(make(), story, (LAMP, EYE))


@on("double-serial")
def test_what_makes_no_sense_is_left_out_and_the_master_says_why(make: Callable[..., BoardHome]) -> None:
    async def story(world: BoardWorld) -> None:
        await begin(world, "lamp")
        assert world.master.troubles("front") == [
            "part_2: pin 2 is taken by part_1; wire one of them elsewhere",
            'part_3: the library has no part number "HCSR04"; did you mean "HC-SR04" or "HC-SR501"?',
        ]

    play(make(), story, (LAMP, "RELAY-1 relay: s=2", "HCSR04 eye: trigger=5"))


KEY = bytes(range(16))
OTHER_KEY = bytes(range(1, 17))
KEYS = {
    UID: KEY,
    PARTNER_UID: OTHER_KEY,
    uid_on_board(UID, "HC-SR04", "eye"): KEY,
    uid_on_board(UID, "LED", "lamp"): KEY,
}


@on("double-can", "vm-serial")
@pytest.mark.parametrize("authentication", ["key", "key+data"])
def test_in_a_robot_with_keys_each_part_proves_the_key_of_the_board(
    make: Callable[..., BoardHome], authentication: str
) -> None:
    async def story(world: BoardWorld) -> None:
        await begin(world, "eye", "lamp")
        world.send("lamp/on", on=True)
        await asyncio.sleep(0.5)
        assert looker(world)(2) == ["out", FULL]
        assert world.heard["eye/distance"]
        # Known to nobody: the board's key does not let in a part whose UID the robot has no key for.
        world.wire((EYE, LAMP, ARM))
        await asyncio.sleep(5.0)
        assert world.states()["arm"] == "refused"
        assert "this robot asks for keys, and has none for this part" in " ".join(world.master.why("arm"))
        world.store.keys[uid_on_board(UID, "SG90", "arm")] = KEY
        await world.until(arm="active", eye="active", lamp="active")

    play(make(key=KEY), story, (EYE, LAMP), KEYS, authentication)


@on("double-can")
def test_a_board_with_a_wrong_key_is_not_let_in_nor_are_its_parts(make: Callable[..., BoardHome]) -> None:
    kept: dict[str, str] = {}

    async def learn(world: BoardWorld) -> None:
        await begin(world, "eye", "lamp")
        kept.update(world.board.files())

    play(make(key=KEY), learn, (EYE, LAMP), KEYS)

    async def story(world: BoardWorld) -> None:
        world.plug()
        world.board.machine("set_echo", 5831)
        await asyncio.sleep(10.0)
        sentence = "the part's key is not the one on file for its UID"
        for who in ("front", "eye", "lamp"):
            assert sentence in " ".join(world.master.why(who)), world.master.why(who)
        assert looker(world)(2) == ["out", 0]  # safe all the same

    play(make(kept, OTHER_KEY), story, (EYE, LAMP), KEYS)
