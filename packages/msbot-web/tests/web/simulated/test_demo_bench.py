"""The demo's simulated parts and bus, as the page plays with them."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from random import Random

import pytest

from msbot.config import load_blueprint, load_library, write_sample
from msbot.pnp import MemoryStore
from msbot.process.virtual_time import run_virtual
from msbot.registry import open_registry
from msbot_school.demo import DemoLinkKind, DemoRobot
from msbot_web.assembly import PageSources
from msbot_web.demo_controls import DemoControls, seen_of
from msbot_web.simulated.controls import NoSimulatedControls
from msbot_xrce.errors import ConfigError


def play(
    folder: Path,
    sample: str,
    scene: Callable[[DemoRobot, DemoControls, PageSources], Awaitable[None]],
    *,
    wire: DemoLinkKind = DemoLinkKind.CAN,
    spares: dict[str, str] | None = None,
) -> None:
    """Run a demo in virtual time, with what its page sees of it."""

    async def main() -> None:
        write_sample(folder / "robot.toml", sample)
        library = load_library()
        blueprint = load_blueprint(folder / "robot.toml", library)
        with open_registry(folder / "robot.db") as registry:
            record = registry.robots.apply_blueprint(blueprint, library)
            robot = DemoRobot(
                blueprint,
                registry.runs.begin(record),
                wire=wire,
                library=library,
                random=Random(1),
                epoch_ns=lambda: 0,
                spares=spares,
            )
            seen = seen_of(robot, asyncio.get_running_loop().time)
            async with asyncio.TaskGroup() as tasks:
                running = tasks.create_task(robot.run())
                await robot.master.ready.wait()
                await asyncio.sleep(2.0)
                assert isinstance(seen.bench, DemoControls)
                await scene(robot, seen.bench, seen)
                robot.finish()
                await running

    run_virtual(main())


def test_a_knob_is_turned_and_the_fan_obeys(tmp_path: Path) -> None:
    async def scene(robot: DemoRobot, bench: DemoControls, seen: PageSources) -> None:
        (turn, *_) = bench.controls("knob")
        assert turn.kind == "number"
        assert turn.least is not None
        bench.operate("knob", turn.name, 100)  # a whole number will do
        await asyncio.sleep(1.0)
        assert next(control.value for control in bench.controls("knob") if control.name == turn.name) == 100.0
        speed = bench.readings("fan")["speed"]
        assert isinstance(speed, float)
        assert speed > 1000
        bench.operate("knob", turn.name, 0)
        async with asyncio.timeout(60.0):
            while bench.readings("fan")["speed"] != 0.0:  # noqa: ASYNC110 - virtual time costs nothing
                await asyncio.sleep(0.5)
        with pytest.raises(ConfigError, match="wobble"):
            bench.operate("knob", "wobble", 1)
        with pytest.raises(ConfigError):
            bench.operate("knob", turn.name, "much")
        with pytest.raises(ConfigError):
            bench.operate("knob", turn.name, True)

    play(tmp_path, "rover", scene)


def test_parts_are_pulled_and_plugged(tmp_path: Path) -> None:
    async def scene(robot: DemoRobot, bench: DemoControls, seen: PageSources) -> None:
        assert bench.slots() == robot.names
        assert bench.is_plugged("horn")
        bench.unplug("horn")
        bench.unplug("horn")
        assert not bench.is_plugged("horn")
        assert bench.controls("horn") == ()
        with pytest.raises(ConfigError, match="horn has nothing that could be operated, or is not plugged in"):
            bench.operate("horn", "x", 1)
        await asyncio.sleep(6.5)
        (horn,) = [
            info for info in robot.master.inventory.view(asyncio.get_running_loop().time()) if info.slot == "horn"
        ]
        assert horn.state.value == "lost"
        bench.plug("horn")
        bench.plug("horn")
        assert bench.is_plugged("horn")

    play(tmp_path, "rover", scene)


def test_of_the_thesis_three_the_pins_are_seen(tmp_path: Path) -> None:
    async def scene(robot: DemoRobot, bench: DemoControls, seen: PageSources) -> None:
        assert bench.slots() == ("AA", "BB", "CC", "DD")
        assert bench.controls("AA") == ()
        await asyncio.sleep(2.0)
        lit = [f"pin {pin}" for pin, level in enumerate(robot.board("BB").levels()) if level]
        assert list(bench.readings("BB")) == lit != []
        assert seen.frames.total > 20
        assert seen.bus is not None
        assert (seen.bus.bitrate, seen.bus.errors()) == (500_000, 0)
        assert 0 < seen.bus.load_percent() < 100

    play(tmp_path, "thesis", scene, spares={"DD": "BB"})


def test_without_a_can_bus_there_is_none_to_see(tmp_path: Path) -> None:
    async def main() -> None:
        write_sample(tmp_path / "robot.toml")
        blueprint = load_blueprint(tmp_path / "robot.toml", load_library())
        robot = DemoRobot(blueprint, MemoryStore(), wire=DemoLinkKind.UDP)
        seen = seen_of(robot, asyncio.get_running_loop().time)
        assert seen.bus is None
        assert isinstance(seen.bench, DemoControls)
        assert not seen.bench.is_plugged("AA")

    run_virtual(main())


class Device:
    """A simulated device of a bridge."""

    def __init__(self, name: str, part_number: str) -> None:
        self.name, self.part_number, self.is_plugged = name, part_number, True

    def plug(self) -> bool:
        was, self.is_plugged = self.is_plugged, True
        return not was

    def unplug(self) -> bool:
        was, self.is_plugged = self.is_plugged, False
        return was


def test_devices_behind_bridges_are_pulled_at_their_slots_and_spares_by_their_name(tmp_path: Path) -> None:
    async def main() -> None:
        write_sample(tmp_path / "robot.toml", "thesis")
        blueprint = load_blueprint(tmp_path / "robot.toml", load_library())
        number = blueprint.slots[0].part_number
        own, spare = Device("arm", number), Device("AA", "ACME:spare")
        names = ("AA", "BB")
        robot = DemoRobot(blueprint, MemoryStore(), names=names, bridged=names, devices=[spare, own])
        assert robot.names == ("AA", "BB", "AA2")
        assert robot.is_plugged("AA")
        running = asyncio.create_task(robot.run())
        await robot.begun.wait()
        assert robot.unplug("AA")
        assert (own.is_plugged, spare.is_plugged) == (False, True)
        assert not robot.unplug("AA")
        assert robot.plug("AA")
        assert robot.unplug("AA2")
        assert not spare.is_plugged
        assert not robot.plug("BB"), "a device that the demo does not have cannot be plugged in"
        assert {part.name: part.plugged for part in robot.snapshot().parts} == {"AA": True, "BB": False, "AA2": False}
        robot.finish()
        await running

    run_virtual(main())


def test_a_robot_without_simulated_parts_has_an_empty_bench() -> None:
    bench = NoSimulatedControls()
    bench.plug("AA")
    bench.unplug("AA")
    bench.operate("AA", "x", 1)
    assert (bench.slots(), bench.is_plugged("AA"), bench.controls("AA"), bench.readings("AA")) == ((), False, (), {})


def test_a_demo_of_months_keeps_the_latest_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("msbot_school.demo.demo_robot.MOST_EVENTS", 6)

    async def scene(robot: DemoRobot, _bench: DemoControls, _seen: PageSources) -> None:
        assert len(robot.events) == 6
        robot.unplug("AA")
        await asyncio.sleep(10.0)
        assert len(robot.events) == 6
        assert (robot.events[-1].part, robot.events[-1].to_state) == ("AA", "lost")

    play(tmp_path, "thesis", scene)
