"""`msbot demo --script`: each step happens, or is told."""

from __future__ import annotations

import asyncio
from pathlib import Path
from random import Random

from msbot.config import SAMPLES, load_library, parse_blueprint
from msbot.process.virtual_time import run_virtual
from msbot.registry import open_registry
from msbot_school.demo import DemoLinkKind, DemoRobot
from msbot_web.cli.demo.script import ScriptRun, ScriptType
from msbot_xrce.errors import ConfigError


def played(folder: Path, script: str, until_s: float) -> tuple[list[str], list[tuple[str, str]]]:
    """What is said while a robot runs, and which states BB and DD went to."""
    said: list[str] = []
    states: list[tuple[str, str]] = []

    async def nothing_to_undo() -> str:
        raise ConfigError("there is nothing to take back")

    async def main() -> None:
        library = load_library()
        with open_registry(folder / "robot.db") as registry:
            blueprint = parse_blueprint(SAMPLES["thesis"], library)
            store = registry.runs.begin(registry.robots.apply_blueprint(blueprint, library))
            robot = DemoRobot(blueprint, store, wire=DemoLinkKind.CAN, spares={"DD": "BB"}, random=Random(1))
            robot.on_event(lambda event: states.append((event.part, event.to_state)))
            run = ScriptRun(ScriptType().convert(script, None, None), robot, nothing_to_undo, said.append)
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(robot.run())
                playing = tasks.create_task(run.run())
                await asyncio.sleep(until_s)
                robot.finish()
                playing.cancel()
            run.end()

    run_virtual(main())
    return said, states


def test_a_step_before_the_parts_are_in_waits_for_them(tmp_path: Path) -> None:
    said, states = played(tmp_path, "0:unplug BB;3:plug BB", 5.0)
    assert said == []
    assert [state for part, state in states if part == "BB"].count("active") == 2, "in, out, and in again"


def test_what_does_nothing_and_what_was_never_done_is_told(tmp_path: Path) -> None:
    said, _ = played(tmp_path, "0:unplug DD;2:plug BB;2.5:undo;30:unplug CC;31:undo", 5.0)
    assert said == [
        "--script: 0:unplug DD does nothing: DD is not plugged in",
        "--script: 2:plug BB does nothing: BB is plugged in already",
        "undo: there is nothing to take back",
        "--script: the demo has ended before 30:unplug CC; 31:undo",
    ]
