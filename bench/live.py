"""How quickly a running robot follows what people do: CONFIGURE, a moved wire, STOP, a claim with and without a key.

In virtual time on simulated CAN buses: exact, the same on every machine. The robot is a master and two parts, knob and
fan; the bus carries the knob's 20 samples a second and the beats besides.

    python -m bench.live
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from random import Random

from bench.buses import BUSES, CODEC, Rates, table
from msbot.config import Blueprint, Options, PartType, RobotProfile, Slot
from msbot.master import Master
from msbot.part import Part
from msbot.part.messages.standard import Level
from msbot.pnp import Configuration, MemoryStore, SlotBinding
from msbot.process.virtual_time import run_virtual
from msbot_agent.link.can import CanMasterLink, CanPartLink
from msbot_agent.link.can.sim import SimBusDriver

KEY = bytes(range(16))
ROUNDS = 20
"""How often each is done; the moments are spread over the period of the samples."""

_PROFILE = RobotProfile("BENCH", "1", "1", "today", "us")
_KNOB = SlotBinding("level", "power", "Level", publishes=True, reliable=False)
_FAN = SlotBinding("power", "power", "Level", publishes=False, reliable=False)


@dataclass
class Figures:
    """Milliseconds; the largest of all rounds."""

    setting: float = 0.0
    """From the master's notice of a changed setting to the part's function."""
    wire: float = 0.0
    """From the moved wire to the first sample on it; there is one every 50 ms."""
    stop: float = 0.0
    """From STOP to the fan's function with its safe value."""
    joined: float = 0.0
    """From plugging in to `active`, at the part."""


def main() -> None:
    """Print the table."""
    logging.disable()
    rows = []
    for rates in BUSES:
        open_mode, key_mode = (run_virtual(measure(rates, authentication)) for authentication in ("open", "key"))
        cells = (open_mode.setting, open_mode.wire, open_mode.stop, open_mode.joined, key_mode.joined)
        rows.append([rates.name, *(f"{cell:.1f}" for cell in cells)])
    head = ["bus", "setting, ms", "wire, ms", "STOP, ms", "plug-in to active, ms", "with keys, ms"]
    print("\n".join(table(head, rows)))


async def measure(rates: Rates, authentication: str) -> Figures:
    """One robot on one bus."""
    robot = _Robot(rates, authentication)
    serving = asyncio.get_running_loop().create_task(robot.master.run())
    await robot.master.ready.wait()
    await asyncio.sleep(2.1)
    await robot.plug_in()
    figures = Figures(joined=robot.joined_ms)
    for turn in range(ROUNDS):
        await asyncio.sleep(0.3 + 0.05 * turn / ROUNDS)
        figures.setting = max(figures.setting, await robot.until_heard(robot.change_setting, robot.gains))
        await asyncio.sleep(0.3)
        figures.wire = max(figures.wire, await robot.until_heard(robot.move_wire, robot.powers))
        await asyncio.sleep(0.3)
        figures.stop = max(figures.stop, await robot.until_heard(robot.stop, robot.powers))
        robot.master.say_go("bench")
    for task in (*robot.tasks, serving):
        task.cancel()
    await asyncio.gather(*robot.tasks, serving, return_exceptions=True)
    return figures


class _Robot:
    def __init__(self, rates: Rates, authentication: str) -> None:
        self.random = Random(1)
        self.store = MemoryStore(
            types=(PartType("POT", "knob"), PartType("FAN", "fan")),
            slots=(Slot("knob", "POT"), Slot("fan", "FAN")),
            configurations=(
                Configuration(1, "knob", (_KNOB,), (("gain", "1"),)),
                Configuration(1, "fan", (_FAN,), (("power.safe.percent", "0"),)),
            ),
        )
        blueprint = Blueprint(_PROFILE, (), options=Options(authentication=authentication))
        self.master = Master(blueprint, self.store, random=self.random, epoch_ns=lambda: 0)
        self.driver = SimBusDriver(rates.bus())
        self.driver.attach("monitor")
        end = self.driver.attach("master")
        profile_hash = self.master.profile.profile_hash()
        self.master.add_link(
            CanMasterLink(end, profile_hash=profile_hash, random=self.random, fd=rates.fd, codec=CODEC)
        )
        self.gains: list[object] = []
        self.powers: list[object] = []
        self.tasks: list[asyncio.Task[None]] = []
        self.joined_ms = 0.0
        self._topic = "power"

    async def plug_in(self) -> None:
        """Both parts, one after the other; the second one's way is the figure."""
        loop = asyncio.get_running_loop()
        knob, fan = self._part("POT"), self._part("FAN")
        knob.every(0.05)(lambda: knob.publish("level", Level(percent=50.0)))
        knob.on_setting("gain", float)(self.gains.append)
        fan.on("power", Level)(self.powers.append)
        for part in (knob, fan):
            joined = asyncio.Event()
            part.on_join(joined.set)
            assert part.uid is not None
            link = CanPartLink(self.driver.attach(part.local_name), uid=part.uid, random=self.random, codec=CODEC)
            began_at = loop.time()
            self.tasks.append(loop.create_task(part.run_async(link, epoch_ns=lambda: 0)))
            await joined.wait()
            self.joined_ms = (loop.time() - began_at) * 1000

    async def until_heard(self, action: Callable[[], None], heard: list[object]) -> float:
        """Milliseconds from the action until the part's function is called."""
        loop = asyncio.get_running_loop()
        heard.clear()
        began_at = loop.time()
        action()
        while not heard:  # noqa: ASYNC110 - virtual time costs nothing
            await asyncio.sleep(0.00005)
        return (loop.time() - began_at) * 1000

    def change_setting(self) -> None:
        knob = self.store.configurations["knob"]
        gain = float(dict(knob.settings)["gain"]) + 1
        self._configure(replace(knob, version=knob.version + 1, settings=(("gain", f"{gain:g}"),)))

    def move_wire(self) -> None:
        """Both ends to another topic; what comes on the old one does not count."""
        self._topic = "power" if self._topic == "other" else "other"
        for slot in ("fan", "knob"):
            old = self.store.configurations[slot]
            binding = replace(old.bindings[0], topic=self._topic)
            self._configure(replace(old, version=old.version + 1, bindings=(binding,)))
        self.powers.clear()

    def stop(self) -> None:
        self.master.say_stop("bench")

    def _configure(self, configuration: Configuration) -> None:
        self.store.configurations[configuration.slot] = configuration
        self.master.inventory.configuration_changed(configuration.slot)

    def _part(self, number: str) -> Part:
        uid = self.random.randbytes(8)
        self.store.keys[uid] = KEY
        return Part(number, local_name=number.lower(), uid=uid, key=KEY, random=Random(number))


if __name__ == "__main__":
    main()
