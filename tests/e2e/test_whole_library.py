"""Every part type that MsBOT brings, in one robot at once: each finds its slot by itself."""

from __future__ import annotations

import asyncio
from pathlib import Path
from random import Random

from msbot.config import load_blueprint, load_library
from msbot.master import Master
from msbot.process.virtual_time import run_virtual
from msbot.registry import open_registry
from msbot.sim import SimulatedPart, make_simulator
from msbot_agent.link import InprocHub

LIBRARY = load_library()
PROFILE = '[robot]\nname = "R"\nversion = "1"\nserial_number = "2"\nreleased = "3"\nmanufacturer = "4"\n'


def test_one_of_each_type_makes_a_robot(tmp_path: Path) -> None:
    slots = {f"the {number}": number for number in LIBRARY.numbers()}
    text = PROFILE + "".join(f'[[slot]]\nname = "{name}"\npart = "{number}"\n' for name, number in slots.items())
    (tmp_path / "robot.toml").write_text(text)
    blueprint = load_blueprint(tmp_path / "robot.toml", LIBRARY)

    async def main() -> list[SimulatedPart]:
        with open_registry(tmp_path / "robot.db") as registry:
            store = registry.runs.begin(registry.robots.apply_blueprint(blueprint, LIBRARY))
            master = Master(blueprint, store, random=Random(1), epoch_ns=lambda: 0)
            hub = InprocHub()
            master.add_link(hub.server)
            simulated = [
                make_simulator(number, uid=at.to_bytes(8, "big"), local_name=name, random=Random(at), library=LIBRARY)
                for at, (name, number) in enumerate(slots.items(), 1)
            ]
            async with asyncio.TaskGroup() as tasks:
                running = [tasks.create_task(master.run())]
                await master.ready.wait()
                running += [
                    tasks.create_task(one.part.run_async(hub.connect(), epoch_ns=lambda: 0)) for one in simulated
                ]
                await asyncio.sleep(20)
                seen = {one.part.part_number: (one.part.state.value, one.part.slot) for one in simulated}
                assert seen == {number: ("active", name) for name, number in slots.items()}
                for task in running:
                    task.cancel()
            return simulated

    for one in run_virtual(main()):
        assert one.part.counters.handler_errors == 0
        assert one.part.counters.missed_beats == 0
