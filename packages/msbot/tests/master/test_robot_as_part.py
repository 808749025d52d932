"""An arm with a master of its own in one slot of a rover: ports both ways, STOP, and each without the other."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from random import Random

import pytest

from msbot.config import Blueprint, Library, PartType, Slot, load_blueprint, load_library
from msbot.master import Master, RobotAsPart, exported_ports
from msbot.part import HelloWorld, JoinState, NotSafeYet, Part
from msbot.pnp import Configuration, MemoryStore, SlotBinding
from msbot.process.virtual_time import run_virtual
from msbot_agent.link import InprocHub, LossyLink
from msbot_xrce.errors import ConfigError

ARM = """
[robot]
name = "ARM"
[[slot]]
name = "hand"
part = "EFGH"
[[binding]]
topic = "order"
type = "HelloWorld"
from = ""
to = ["hand.in"]
export = true
[[binding]]
topic = "report"
type = "HelloWorld"
from = "hand.out"
to = []
export = true
"""
LIBRARY = load_library()


def arm_blueprint(folder: Path, text: str = ARM) -> Blueprint:
    path = folder / "arm.toml"
    path.write_text(text)
    return load_blueprint(path, LIBRARY)


def master_of(blueprint: Blueprint, wires: dict[str, tuple[SlotBinding, ...]], seed: int) -> tuple[Master, InprocHub]:
    """A master with a wire of its own for parts, which are not trusted more than others."""
    store = MemoryStore(
        types=tuple(PartType(slot.part_number, slot.name) for slot in blueprint.slots),
        slots=blueprint.slots,
        configurations=tuple(Configuration(1, slot, bindings) for slot, bindings in wires.items()),
    )
    master, hub = Master(blueprint, store, random=Random(seed), epoch_ns=lambda: 0), InprocHub()
    hub.server.info = replace(hub.server.info, name=f"wire {seed}")
    master.add_link(hub.server)
    return master, hub


def says(port: str, topic: str) -> SlotBinding:
    return SlotBinding(port, topic, "HelloWorld", publishes=True)


def hears(port: str, topic: str) -> SlotBinding:
    return SlotBinding(port, topic, "HelloWorld", publishes=False)


@dataclass
class Robots:
    """Both robots; `desk` is a part of the rover that talks with the arm, `hand` one of the arm."""

    rover: Master
    arm: Master
    as_part: RobotAsPart
    cable: list[LossyLink]
    desk: Part
    hand: Part
    said: list[str]
    desk_heard: list[int] = field(default_factory=list)
    hand_heard: list[int] = field(default_factory=list)

    def cut(self, drop: float) -> None:
        """Cut (1.0) or mend (0.0) the cable between the robots."""
        for link in self.cable:
            link.disturbance.drop = drop

    def order(self, index: int) -> None:
        self.desk.publish("out", HelloWorld(index=index, message="do"))

    def report(self, index: int) -> None:
        self.hand.publish("out", HelloWorld(index=index, message="done"))


def play(folder: Path, scene: Callable[[Robots], Awaitable[None]]) -> Robots:
    """Run a scene that begins when the arm is in its slot and all parts are active."""

    async def main() -> Robots:
        blueprint = arm_blueprint(folder)
        slots = (Slot("arm", "ARM-1"), Slot("desk", "DESK"))
        arm, arm_wire = master_of(blueprint, {"hand": (says("out", "report"), hears("in", "order"))}, 1)
        rover, rover_wire = master_of(
            Blueprint(replace(blueprint.robot, name="ROVER"), slots),
            {
                "arm": (hears("order", "wish"), says("report", "answer")),
                "desk": (says("out", "wish"), hears("in", "answer")),
            },
            2,
        )
        cable: list[LossyLink] = []

        def open_link(uid: bytes) -> LossyLink:
            assert len(uid) == 8
            cable.append(LossyLink(rover_wire.connect(), random=Random(3)))
            return cable[-1]

        said: list[str] = []
        as_part = RobotAsPart(
            arm, exported_ports(blueprint, LIBRARY), number="ARM-1", open_link=open_link, say=said.append
        )
        desk, hand = Part("DESK", uid=b"the desk", random=Random(4)), Part("EFGH", uid=b"the hand", random=Random(5))
        robots = Robots(rover, arm, as_part, cable, desk, hand, said)

        @desk.on("in", HelloWorld)
        def desk_hears(message: HelloWorld) -> None:
            robots.desk_heard.append(message.index)

        @hand.on("in", HelloWorld)
        def hand_hears(message: HelloWorld) -> None:
            robots.hand_heard.append(message.index)

        async with asyncio.TaskGroup() as tasks:
            running = [tasks.create_task(work) for work in (rover.run(), arm.run())]
            await asyncio.gather(rover.ready.wait(), arm.ready.wait())
            for work in (
                as_part.run(),
                desk.run_async(rover_wire.connect(), epoch_ns=lambda: 0),
                hand.run_async(arm_wire.connect(), epoch_ns=lambda: 0),
            ):
                running.append(tasks.create_task(work))
            await asyncio.sleep(3)
            assert as_part.part.state is desk.state is hand.state is JoinState.ACTIVE
            await scene(robots)
            for task in running:
                task.cancel()
        return robots

    return run_virtual(main())


def test_the_arm_is_one_part_of_the_rover_and_its_exported_topics_are_its_ports(tmp_path: Path) -> None:
    async def scene(robots: Robots) -> None:
        now = asyncio.get_running_loop().time()
        parts = {info.part_number: info.slot for info in robots.rover.inventory.view(now)}
        assert parts == {"ARM-1": "arm", "DESK": "desk"}
        for index in range(5):
            robots.order(index)
            robots.report(10 + index)
            await asyncio.sleep(0.1)

    robots = play(tmp_path, scene)
    assert robots.hand_heard == [0, 1, 2, 3, 4]
    assert robots.desk_heard == [10, 11, 12, 13, 14]
    assert "ARM is in slot arm of the bigger robot" in robots.said


def test_stop_of_the_rover_is_stop_of_the_arm_and_so_is_go(tmp_path: Path) -> None:
    async def scene(robots: Robots) -> None:
        robots.rover.say_stop("ann")
        await asyncio.sleep(2)
        assert robots.arm.stop.stopped
        assert robots.arm.stop.by == "the bigger robot"
        assert robots.hand.stopped
        robots.rover.say_go("ann")
        await asyncio.sleep(2)
        assert not robots.arm.stop.stopped
        assert not robots.hand.stopped

    play(tmp_path, scene)


def test_a_stop_that_was_said_at_the_arm_is_not_ended_by_the_rover(tmp_path: Path) -> None:
    async def scene(robots: Robots) -> None:
        robots.arm.say_stop("bob")
        await asyncio.sleep(1)
        assert not robots.rover.stop.stopped
        robots.rover.say_stop("ann")
        await asyncio.sleep(1)
        robots.rover.say_go("ann")
        await asyncio.sleep(2)
        assert robots.arm.stop.stopped
        assert robots.hand.stopped

    play(tmp_path, scene)


def names(master: Master) -> list[str]:
    """The parts that have not confirmed STOP."""
    return list(master.stop.silent)


def test_the_arm_confirms_a_stop_of_the_rover_when_all_its_parts_have(tmp_path: Path) -> None:
    async def scene(robots: Robots) -> None:
        moves = [True]

        @robots.hand.safe_state
        def brake() -> None:
            if moves[0]:
                raise NotSafeYet("it moves")

        robots.rover.say_stop("ann")
        await asyncio.sleep(3)
        assert names(robots.arm) == ["EFGH"]
        assert names(robots.rover) == ["ARM"]
        robots.cut(1.0)
        await asyncio.sleep(20)
        robots.cut(0.0)
        await asyncio.sleep(10)
        assert robots.as_part.part.state is JoinState.ACTIVE
        assert names(robots.rover) == ["ARM"], "away and back: the hand still moves"
        moves[0] = False
        robots.hand.is_safe_now()
        await asyncio.sleep(1)
        assert names(robots.rover) == []

    play(tmp_path, scene)


def test_nobody_at_the_arm_ends_a_stop_of_the_rover(tmp_path: Path) -> None:
    async def scene(robots: Robots) -> None:
        robots.rover.say_stop("ann")
        await asyncio.sleep(1)
        with pytest.raises(ConfigError, match="STOP holds in the bigger robot, where this robot is slot arm: say GO"):
            robots.arm.say_go("bob")
        assert robots.hand.stopped

        robots.cut(1.0)
        await asyncio.sleep(20)
        robots.arm.say_go("bob")  # nobody hears the rover: who is at the arm decides
        await asyncio.sleep(1)
        assert not robots.hand.stopped
        robots.cut(0.0)
        await asyncio.sleep(10)
        assert robots.hand.stopped, "STOP holds in the rover, and it is heard again"
        assert names(robots.rover) == []
        robots.rover.say_go("ann")
        await asyncio.sleep(2)
        assert not robots.hand.stopped
        assert not robots.arm.stop.stopped

    play(tmp_path, scene)


def test_a_go_that_the_arm_missed_holds_when_it_is_back(tmp_path: Path) -> None:
    async def scene(robots: Robots) -> None:
        robots.rover.say_stop("ann")
        await asyncio.sleep(1)
        robots.cut(1.0)
        await asyncio.sleep(20)
        assert robots.arm.stop.stopped, "nobody has said GO, as far as the arm knows"
        robots.rover.say_go("ann")
        await asyncio.sleep(1)
        assert robots.arm.stop.stopped
        robots.cut(0.0)
        await asyncio.sleep(10)
        assert not robots.arm.stop.stopped

    play(tmp_path, scene)


def test_the_arm_goes_on_by_itself_while_the_rover_is_away_and_is_its_part_again_afterwards(tmp_path: Path) -> None:
    async def scene(robots: Robots) -> None:
        robots.cut(1.0)
        await asyncio.sleep(20)
        assert robots.as_part.part.state is not JoinState.ACTIVE
        assert robots.hand.state is JoinState.ACTIVE
        robots.report(1)  # nobody hears it
        robots.cut(0.0)
        await asyncio.sleep(10)
        robots.report(2)
        robots.order(3)
        await asyncio.sleep(1)

    robots = play(tmp_path, scene)
    assert robots.desk_heard == [2]
    assert robots.hand_heard == [3]
    assert any("has lost the bigger robot, its ports have their safe values" in words for words in robots.said)


def test_a_robot_that_exports_nothing_is_no_part(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="ARM has nothing to offer a bigger robot: write export = true"):
        exported_ports(arm_blueprint(tmp_path, ARM.replace("export = true", "")), LIBRARY)


def test_a_port_has_the_safe_value_of_what_it_drives(tmp_path: Path) -> None:
    text = ARM.replace('"EFGH"', '"GRIPPER"').replace('type = "HelloWorld"\nfrom = ""', 'type = "Level"\nfrom = ""')
    text = text.replace("hand.in", "hand.grip").replace('"HelloWorld"', '"Switch"').replace("hand.out", "hand.holding")
    order, report = exported_ports(arm_blueprint(tmp_path, text), LIBRARY)
    assert (order.name, order.publishes, order.safe) == ("order", False, order.message(percent=0.0))
    assert (report.name, report.publishes, report.safe) == ("report", True, None)


def test_a_type_that_the_library_does_not_know_cannot_be_exported(tmp_path: Path) -> None:
    blueprint = arm_blueprint(tmp_path)
    strange = replace(blueprint, bindings=(replace(blueprint.bindings[0], type_name="Strange"),))
    with pytest.raises(ConfigError, match="topic 'order' is exported, but the library does not know the fields of"):
        exported_ports(strange, Library((), {}))
