"""A recording as a bag: genuine ROS 2 publishes what is in it, and a robot's parts act on it."""

from __future__ import annotations

import asyncio
from pathlib import Path

from msbot.recording.recorder.batch import Unpacker
from msbot.recording.recorder.recorder import Recorder
from tests.lab.recorded import BEGAN_NS, store
from tests.ros.genuine.node import Node
from tests.ros.genuine.robots import LIBRARY, robot
from tests.space.dds.peers import until

POWER = "/ROVER/power"


async def test_a_bag_of_one_robot_moves_another(tmp_path: Path, node: Node) -> None:
    recorder = Recorder(asyncio.get_running_loop().time, lambda: BEGAN_NS, LIBRARY)
    (tmp_path / "first").mkdir()
    async with robot(tmp_path / "first", recorder=recorder) as rover:
        rover.parts["knob"].set("knob", 80)
        await until(lambda: rover.parts["fan"].source("speed") > 0, "the fan turns")  # type: ignore[operator]
    bag = tmp_path / "bag.mcap"
    store(Unpacker().feed(recorder.drain()), bag, as_bag=True)  # as `rec start --ros2` writes it
    async with robot(tmp_path, parts=("fan",)) as rover:
        fan = rover.parts["fan"]
        assert fan.source("speed") == 0
        await node.does("listen", type="std_msgs/msg/Float32", name=POWER)
        played = 0
        while not fan.source("speed"):  # what is published before both know of each other is heard by nobody
            played += await node.does("play", file=str(bag), topic=POWER, until=2)
            await asyncio.sleep(0.05)
        assert (await node.does("came", name=POWER))[0] == {"data": 80.0}
        assert played > 0
