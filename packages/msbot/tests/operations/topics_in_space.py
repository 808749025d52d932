"""What people do with topics, in a data space of any kind: the tour that `msbot topic` makes possible."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping
from pathlib import Path
from random import Random
from typing import Any

from msbot.cli.topic.rates import MessageWindow
from msbot.config import load_library, parse_blueprint
from msbot.master import Master, robot_space
from msbot.operations.dispatch import InProcessOperations
from msbot.part.messages.standard import Level
from msbot.registry import open_registry
from msbot.sim import make_simulator
from msbot_agent.link import InprocHub, LinkInfo
from msbot_agent.space import Qos, Topic, parse_space
from tests.operations.stage import put_database
from tests.space.dds.peers import until

LIBRARY = load_library()
ROBOT = """
[robot]
name = "ROVER"
[timing]
preset = "fast"
[options]
free_topics = ["chat"]
[[slot]]
name = "knob"
part = "POT-10K"
settings = { period_s = 0.05, change = 0.0 }
[[slot]]
name = "fan"
part = "FAN-5V"
[[binding]]
topic = "light"
type = "Level"
from = "knob.level"
to = []
[[binding]]
topic = "power"
type = "Level"
from = ""
to = ["fan.power"]
"""


async def tour(folder: Path, address: str) -> None:
    """List, info, echo, hz, bw and pub, at a robot in that space; messages of another program are seen, too."""
    blueprint = parse_blueprint(ROBOT, LIBRARY)
    put_database(folder / "rover.db")
    with (
        open_registry(folder / "rover.db") as registry,
        robot_space(parse_space(address), blueprint, LIBRARY) as space,
        robot_space(parse_space(address), blueprint, LIBRARY) as elsewhere,
    ):
        number = registry.robots.apply_blueprint(blueprint, LIBRARY)
        master = Master(blueprint, registry.runs.begin(number), space=space, library=LIBRARY)
        operations = InProcessOperations(master, registry, number, library=LIBRARY)
        hub = InprocHub()
        hub.server.info = LinkInfo("wire", 65535)
        master.add_link(hub.server)

        async def ask(question: str, **arguments: object) -> Mapping[str, Any]:
            return (await operations.do(question, who="ann", **arguments)).answer

        async with asyncio.TaskGroup() as tasks:
            running = [tasks.create_task(master.run())]
            await master.ready.wait()
            parts = {}
            for kind, slot in (("POT-10K", "knob"), ("FAN-5V", "fan")):
                made = parts[slot] = make_simulator(
                    kind, uid=f"{slot:.<8}".encode(), local_name=slot, random=Random(1), library=LIBRARY
                )
                running.append(tasks.create_task(made.part.run_async(hub.connect())))
            await until(lambda: all(one.part.state.value == "active" for one in parts.values()), "both parts")
            # list, info
            topics = {one["topic"]: one for one in (await ask("topics"))["topics"]}
            assert [*topics] == ["light", "power", "chat"]
            assert topics["light"]["publishers"] == [{"slot": "knob", "port": "level", "part": "POT-10K"}]
            assert topics["light"]["fields"] == [["percent", "float32"]]
            # echo, hz, bw
            after, seen = (await ask("topic_samples", topic="light"))["next"], MessageWindow(100)
            for _ in range(3):
                found = await ask("topic_samples", topic="light", after=after, wait=3.0)
                assert found["missed"] == 0
                for one in found["samples"]:
                    assert one["slot"] == "knob"
                    assert 0 <= one["fields"]["percent"] <= 100
                    seen.add(one["at"], one["octets"])
                after = found["next"]
            rate, bandwidth = seen.rate, seen.bandwidth(time.time())
            assert rate is not None
            assert bandwidth is not None
            assert 0 < rate.hz < 1000
            # pub, and what another program says
            await operations.do("publish_topic", who="ann", topic="power", values=["80"])
            await until(lambda: bool(parts["fan"].source("speed")), "the fan turns")
            begun = (await ask("topic_samples", topic="power"))["next"]
            if space.words is not None:  # a space that other programs are in
                writer = elsewhere.writer(Topic("power", "Level"), Qos(), b"another program.")
                while True:  # what is said before both know of each other is heard by nobody
                    writer.write(Level(percent=12).encode())
                    heard = (await ask("topic_samples", topic="power", after=begun, wait=0.2))["samples"]
                    if heard:
                        break
                assert (heard[0]["slot"], heard[0]["fields"]) == ("", {"percent": 12.0})
                writer.close()
            for task in running:
                task.cancel()
