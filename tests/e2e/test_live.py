"""A robot on a simulated CAN bus while people change it: settings, wires, STOP, partners, keys (R13, R82, R86)."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from random import Random

import pytest

from msbot.config import SlotPort, load_blueprint, load_library
from msbot.master import Master
from msbot.part import Part
from msbot.part.messages.standard import Level
from msbot.pnp import PartState
from msbot.process.virtual_time import run_virtual
from msbot.registry import Registry, RobotRecord, open_registry
from msbot_agent.link.can import CanMasterLink, CanPartLink, Codec
from msbot_agent.link.can.sim import SimBus, SimBusDriver
from msbot_xrce import compress, decompress
from tests.registry.hand import Hand

ROBOT = """
[robot]
name = "FAN_ROBOT"
version = "1"
serial_number = "7"
released = "today"
manufacturer = "us"

[options]
authentication = "{authentication}"

[[slot]]
name = "knob"
part = "POT-10K"
local_name = "knob"

[[slot]]
name = "other knob"
part = "POT-10K"
local_name = "other knob"

[[slot]]
name = "fan"
part = "FAN-5V"

[[binding]]
topic = "power"
type = "Level"
from = "knob.level"
to = ["fan.power"]
reliable = false

[[binding]]
topic = "spare power"
type = "Level"
from = "other knob.level"
to = []
reliable = false
"""
AT_ONCE_S = 0.1


class Robot:
    """The master on a bus of 500 kbit/s, with header compression, and parts that are plugged in by name."""

    def __init__(self, folder: Path, registry: Registry, text: str) -> None:
        (folder / "robot.toml").write_text(text)
        library = load_library()
        blueprint = load_blueprint(folder / "robot.toml", library)
        self.registry = registry
        self.record: RobotRecord = registry.robots.apply_blueprint(blueprint, library)
        self.random = Random(1)
        self.master = Master(blueprint, registry.runs.begin(self.record), random=self.random, epoch_ns=lambda: 0)
        self.driver = SimBusDriver(SimBus(500_000))
        self.driver.attach("monitor")
        self.codec = Codec(compress, decompress)
        self.master.add_link(
            CanMasterLink(
                self.driver.attach("master"),
                profile_hash=self.master.profile.profile_hash(),
                random=self.random,
                codec=self.codec,
            )
        )
        self.tasks: dict[str, asyncio.Task[None]] = {}
        self.links: dict[str, CanPartLink] = {}

    def plug(self, part: Part) -> Part:
        part.uid = part.uid or self.random.randbytes(8)
        link = CanPartLink(self.driver.attach(part.local_name), uid=part.uid, random=self.random, codec=self.codec)
        self.links[part.local_name] = link
        self.tasks[part.local_name] = asyncio.get_running_loop().create_task(part.run_async(link))
        return part

    async def pull(self, name: str) -> None:
        self.driver.detach(name)
        self.tasks[name].cancel()
        await asyncio.gather(self.tasks.pop(name), return_exceptions=True)

    def changed(self, *slots: str) -> None:
        """As `Operations` does after an edit."""
        for slot in slots:
            self.master.inventory.configuration_changed(slot)

    def state(self, name: str) -> PartState:
        """Of the newest part of that name: a claim without proof does not take over the line of the one before."""
        return [info.state for info in self.master.inventory.view(0.0) if info.local_name == name][-1]


def play(
    folder: Path,
    scene: Callable[[Robot], Awaitable[None]],
    *,
    authentication: str = "open",
    changes: tuple[tuple[str, str], ...] = (),
) -> None:
    text = ROBOT.format(authentication=authentication)
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)

    async def main() -> None:
        with open_registry(folder / "robot.db") as registry:
            robot = Robot(folder, registry, text)
            serving = asyncio.get_running_loop().create_task(robot.master.run())
            await robot.master.ready.wait()
            await scene(robot)
            for task in (*robot.tasks.values(), serving):
                task.cancel()
            await asyncio.gather(serving, *robot.tasks.values(), return_exceptions=True)

    run_virtual(main())


def knob(name: str = "knob", says: float = 50.0, **more: str) -> Part:
    part = Part("POT-10K", local_name=name, random=Random(name), **more)  # type: ignore[arg-type]  # key only
    part.every("period_s")(lambda: part.publish("level", Level(percent=says)))
    return part


def fan(story: list[float], **more: str) -> Part:
    part = Part("FAN-5V", local_name="fan", random=Random(7), **more)  # type: ignore[arg-type]  # key only
    part.on("power", Level)(lambda message: story.append(message.percent))
    return part


def test_a_setting_changed_by_hand_reaches_the_part_at_once_and_undo_too(tmp_path: Path) -> None:
    async def scene(robot: Robot) -> None:
        story: list[float] = []
        heard: list[float] = []
        part = robot.plug(knob())
        part.on_setting("period_s", float)(heard.append)
        robot.plug(fan(story))
        await asyncio.sleep(1.0)
        default = part.setting("period_s", float)
        Hand(robot.registry).set_value(robot.record, "knob", "period_s", 0.5, "test")
        robot.changed("knob")
        await asyncio.sleep(AT_ONCE_S)
        assert heard == [default, 0.5]
        before = part.counters.messages_out
        await asyncio.sleep(5.0)
        assert part.counters.messages_out == before + 10
        Hand(robot.registry).undo(robot.record, None, "test")
        robot.changed("knob")
        await asyncio.sleep(AT_ONCE_S)
        assert heard == [default, 0.5, default]

    play(tmp_path, scene)


def test_a_wire_that_is_moved_is_live_at_once_and_the_programs_know_nothing_of_it(tmp_path: Path) -> None:
    async def scene(robot: Robot) -> None:
        story: list[float] = []
        robot.plug(knob("knob", 50.0))
        robot.plug(knob("other knob", 20.0))
        robot.plug(fan(story))
        await asyncio.sleep(1.0)
        assert set(story) == {50.0}
        Hand(robot.registry).unbind(robot.record, "power", SlotPort("fan", "power"), "test")
        Hand(robot.registry).bind(
            robot.record, "spare power", "test", type_name="Level", source=None, targets=[SlotPort("fan", "power")]
        )
        robot.changed("fan", "knob", "other knob")
        await asyncio.sleep(AT_ONCE_S)
        story.clear()
        await asyncio.sleep(1.0)
        assert set(story) == {20.0}

    play(tmp_path, scene)


def test_a_fan_stands_still_when_its_knob_is_pulled_out_and_turns_again_when_it_is_back(tmp_path: Path) -> None:
    async def scene(robot: Robot) -> None:
        story: list[float] = []
        lost: list[str] = []
        robot.plug(knob())
        part = robot.plug(fan(story))
        part.on_partner_lost(lost.append)
        await asyncio.sleep(1.0)
        assert story[-1] == 50.0
        await robot.pull("knob")
        await asyncio.sleep(7.0)
        assert story[-1] == 0.0
        assert lost == ["power"]
        assert part.state.value == "active"
        robot.plug(knob())
        await asyncio.sleep(2.0)
        assert story[-1] == 50.0

    play(tmp_path, scene)


def test_a_part_moves_to_another_robot_with_other_names_and_needs_no_change(tmp_path: Path) -> None:
    story: list[float] = []
    parts = [knob(), fan(story)]
    slots: list[str] = []

    async def scene(robot: Robot) -> None:
        for part in parts:
            robot.plug(part)
        await asyncio.sleep(1.0)
        slots.extend(part.slot for part in parts)
        assert story[-1] == 50.0
        story.clear()

    for name in ("first", "second"):
        (tmp_path / name).mkdir()
    play(tmp_path / "first", scene)
    play(
        tmp_path / "second",
        scene,
        changes=(
            ("FAN_ROBOT", "DRYER"),
            ('name = "knob"\npart', 'name = "heat"\npart'),
            ('name = "fan"', 'name = "blower"'),
            ('"knob.level"', '"heat.level"'),
            ('"fan.power"', '"blower.power"'),
            ('topic = "power"', 'topic = "hot air"'),
        ),
    )
    assert slots == ["knob", "fan", "heat", "blower"]


def test_stop_makes_the_fan_stand_still_within_milliseconds_and_go_lets_it_turn(tmp_path: Path) -> None:
    async def scene(robot: Robot) -> None:
        story: list[float] = []
        robot.plug(knob())
        part = robot.plug(fan(story))
        await asyncio.sleep(1.0)
        beats = part.counters.beats
        assert robot.master.say_stop("ann").told_count == 2
        await asyncio.sleep(0.005)
        assert story[-1] == 0.0
        assert part.counters.beats == beats + 1, "it says at once that it has heard"
        confirmed = robot.master.stop.confirmed
        assert {one.part for one in confirmed} == {"knob", "fan"}
        assert max(one.ms for one in confirmed) < 5
        stood = len(story)
        await asyncio.sleep(2.0)
        assert len(story) == stood
        assert part.stopped
        assert part.counters.held > 0
        robot.master.say_go("ann")
        await asyncio.sleep(1.0)
        assert story[-1] == 50.0

    play(tmp_path, scene)


def test_stop_said_by_a_part_on_the_bus_stops_all_and_the_master_remembers_it(tmp_path: Path) -> None:
    async def scene(robot: Robot) -> None:
        story: list[float] = []
        robot.plug(knob())
        part = robot.plug(fan(story))
        await asyncio.sleep(1.0)
        heard: list[str] = []

        robot.master.on_stop(lambda status: heard.append(status.reason))
        for _ in range(3):
            robot.links["knob"].send_stop()
            await asyncio.sleep(0.5)
        assert len(heard) == 1, "it holds already"
        assert part.stopped
        assert story[-1] == 0.0
        assert robot.master.stop.stopped
        assert robot.master.stop.silent == ()
        await robot.pull("fan")
        await asyncio.sleep(7.0)
        late = robot.plug(fan(story))
        await asyncio.sleep(2.0)
        assert late.state.value == "active"
        assert late.stopped
        assert story[-1] == 0.0
        robot.master.say_go("ann")
        await asyncio.sleep(1.0)
        assert story[-1] == 50.0

    play(tmp_path, scene)


KEY = "00112233445566778899aabbccddeeff"


@pytest.mark.parametrize(
    ("key", "state", "reason"),
    [
        (KEY, PartState.ACTIVE, ""),
        ("ff" * 16, PartState.REFUSED, "the part's key is not the one on file for its UID"),
        ("", PartState.REFUSED, "this robot asks for keys, and the part proves none"),
    ],
    ids=["its key", "another key", "no key"],
)
def test_in_a_robot_with_keys_only_the_part_with_its_key_is_let_in_over_can(
    tmp_path: Path, key: str, state: PartState, reason: str
) -> None:
    async def scene(robot: Robot) -> None:
        part = knob(key=key) if key else knob()
        part.uid = b"knob-uid"
        robot.registry.keys.store(part.uid, bytes.fromhex(KEY), "test")
        began_at = asyncio.get_running_loop().time()
        joined: list[float] = []
        part.on_join(lambda: joined.append(asyncio.get_running_loop().time() - began_at))
        robot.plug(part)
        await asyncio.sleep(20.0)
        assert robot.state("knob") is state
        why = "\n".join(robot.master.inventory.why("knob", asyncio.get_running_loop().time()))
        assert reason in why
        if state is PartState.ACTIVE:
            assert joined[0] < 0.02
            assert part.counters.beats >= 19
            assert part.counters.messages_out > 0
        else:
            assert joined == []
            assert part.counters.messages_out == 0
            await asyncio.sleep(0)
            assert any(reason in entry.event.reason for entry in robot.registry.robots.journal(20, "knob"))

    play(tmp_path, scene, authentication="key")


def test_a_key_that_is_removed_keeps_the_part_out_from_its_next_claim_on(tmp_path: Path) -> None:
    async def scene(robot: Robot) -> None:
        part = knob(key=KEY)
        part.uid = b"knob-uid"
        robot.registry.keys.store(part.uid, bytes.fromhex(KEY), "test")
        robot.plug(part)
        await asyncio.sleep(2.0)
        robot.registry.keys.remove(part.uid, "test")
        await asyncio.sleep(2.0)
        assert robot.state("knob") is PartState.ACTIVE
        await robot.pull("knob")
        await asyncio.sleep(7.0)
        robot.plug(part)
        await asyncio.sleep(5.0)
        assert robot.state("knob") is PartState.REFUSED

    play(tmp_path, scene, authentication="key")
