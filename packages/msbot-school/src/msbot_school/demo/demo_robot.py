"""The sample robot in one process: a master and the thesis' three parts on one wire, which can be pulled out.

Nothing here is a mock: master, agent, parts and the bus are the ones a real robot has; only the wire is simulated
(CAN, bit by bit) or local (UDP on 127.0.0.1). It runs in real time and, on the simulated bus, in virtual time.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from random import Random

from msbot.cli.run.bridges_beside import PluggableDevice
from msbot.config import Blueprint, Library
from msbot.master import Master
from msbot.part import Part, SimGpio
from msbot.part.sample_parts import SAMPLE_PARTS, make_sample
from msbot.pnp import PartEvent, PartInfo, PartState, PartStore
from msbot.sim import SimulatedPart, make_simulator
from msbot.sim.arena.world_connection import WorldConnection
from msbot_agent.link import Link
from msbot_agent.link.can import FrameTap
from msbot_agent.link.can.protocol import NodeIds
from msbot_agent.link.can.sim import SimBusDriver
from msbot_agent.process.end_signals import ungrouped
from msbot_agent.space import Space
from msbot_school.demo.demo_links import (
    BusSnapshot,
    DemoLinkKind,
    DemoLinks,
    DemoSnapshot,
    DemoStateChange,
    PartSnapshot,
    TopicSnapshot,
)
from msbot_xrce.errors import ConfigError, MsbotError

MOST_EVENTS = 1000
"""Changes of parts that are kept; a demo may run for months."""

# One part's place in the demo: what is plugged in there now, and what earlier parts there did.


_SAMPLE_NAMES = {sample.part_number: name for name, sample in SAMPLE_PARTS.items()}


class DemoPlace:
    """A place for one part; the thesis' three are their own programs, all others are simulated from the library.

    Args:
        name: what the place is called.
        slot: the slot that the part is meant for.
        part_number: its part number.
        uid: 8 octets; the same however often it is plugged in.
        library: where its part number is looked up.
        device: the simulated device behind a bridge that is there; its part says its UID. None: a simulated part.
    """

    def __init__(
        self,
        name: str,
        slot: str,
        part_number: str,
        uid: bytes,
        library: Library | None,
        *,
        device: PluggableDevice | None = None,
    ) -> None:
        self.name = name
        self.device = device
        self.is_uid_known = device is None
        self.slot = slot
        self.part_number = part_number
        self.uid = uid
        self.board = SimGpio()
        """Survives unplugging, as a real board would; its pins keep what the part last set."""
        self.part: Part | None = None
        self.simulated: SimulatedPart | None = None
        """The simulated device, to be played with; None for the thesis' three, and for an empty place."""
        self.task: asyncio.Task[None] | None = None
        self.plugged_at: float | None = None
        """When the demo has plugged a part in for the last time; None: never."""
        self.active_at: float | None = None
        self.earlier_in = 0
        self.earlier_out = 0
        self._library = library

    def make(self, random: Random) -> Part:
        """A fresh part for this place."""
        sample = _SAMPLE_NAMES.get(self.part_number)
        if sample is not None:
            own_name = "" if self.name == self.slot else self.name
            self.part = make_sample(sample, uid=self.uid, random=random, board=self.board, local_name=own_name)
        else:
            self.simulated = make_simulator(
                self.part_number, uid=self.uid, local_name=self.name, random=random, library=self._library
            )
            self.part = self.simulated.part
        return self.part

    def clear(self) -> None:
        """Note that the part is unplugged; its counts are kept."""
        self.earlier_in, self.earlier_out = self.messages_in, self.messages_out
        self.part = self.simulated = self.task = None

    @property
    def to_active_ms(self) -> float | None:
        """How long the part has taken from plug-in to active; None: it has not been active since."""
        return None if self.active_at is None or self.plugged_at is None else (self.active_at - self.plugged_at) * 1000

    @property
    def messages_in(self) -> int:
        """Samples that arrived in the part, over all the times it was plugged in."""
        return self.earlier_in + (self.part.counters.messages_in if self.part is not None else 0)

    @property
    def messages_out(self) -> int:
        """Samples that the part published, over all the times it was plugged in."""
        return self.earlier_out + (self.part.counters.messages_out if self.part is not None else 0)


START_LOOK_S = 0.02
"""Period in which the demo checks whether the whole ring is connected, until it is."""
SETTLE_S = 0.25
"""Longest wait at the end for samples still on their way."""
SETTLE_LOOKS = 25
"""How many times the demo checks during that wait whether they have arrived."""


class DemoRobot:
    """The sample robot on one wire. Must be made inside a running event loop.

    Args:
        blueprint: the sample blueprint, or one with the same slots and topics.
        store: library, slots and journal.
        wire: what connects the parts.
        bitrate: nominal bit rate of a CAN wire, bit/s.
        data_bitrate: bit rate of the data phase of CAN FD, bit/s.
        node_ids: where the addresses of parts on a CAN wire are remembered; memory if absent.
        compression: shorten headers on a CAN wire.
        bus_name: what a simulated bus is called where other programs join it; empty: none does.
        names: slots whose parts are in the demo; all if absent.
        spares: further parts by name, each with the slot that it is meant for; plugged in when all others are active.
        unplugged: slots whose parts are not plugged in at the beginning.
        bridged: slots whose parts come from behind a bridge.
        devices: the simulated devices there.
        door: the way into a world; None: the parts are in none.
        library: where parts other than the thesis' three are looked up; MsBOT's own if absent.
        space: where the robot's topics are; memory if absent.
        random: the source of everything random; a seeded one makes a run in virtual time repeatable.
        epoch_ns: wall clock, nanoseconds since 1970.
    """

    def __init__(
        self,
        blueprint: Blueprint,
        store: PartStore,
        *,
        wire: DemoLinkKind = DemoLinkKind.CAN,
        bitrate: int = 500_000,
        data_bitrate: int = 2_000_000,
        node_ids: NodeIds | None = None,
        compression: bool = True,
        bus_name: str = "",
        names: tuple[str, ...] | None = None,
        spares: Mapping[str, str] | None = None,
        unplugged: Collection[str] = (),
        bridged: Collection[str] = (),
        devices: Sequence[PluggableDevice] = (),
        door: WorldConnection | None = None,
        library: Library | None = None,
        space: Space | None = None,
        random: Random | None = None,
        epoch_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._event_listeners: list[Callable[[DemoStateChange], None]] = []
        self.events: deque[DemoStateChange] = deque(maxlen=MOST_EVENTS)
        """What happened last, oldest first."""
        self._random = random or Random()
        self._epoch_ns = epoch_ns
        self._loop = asyncio.get_running_loop()
        self._started_at = self._loop.time()
        self.master = Master(blueprint, store, space=space, random=self._random, epoch_ns=epoch_ns, library=library)
        self._wiring = DemoLinks(
            wire,
            bitrate=bitrate,
            data_bitrate=data_bitrate,
            profile_hash=self.master.profile.profile_hash(),
            random=self._random,
            node_ids=node_ids,
            compression=compression,
            bus_name=bus_name,
        )
        self.master.add_link(self._wiring.master_link)
        self.master.inventory.on_event(self._changed)
        self._spares = dict(spares or {})
        self._bridged = frozenset(bridged)
        self._unplugged = frozenset(unplugged) | self._bridged
        self._door = door
        self._inside: dict[str, str] = {}
        """Slot -> the plug whose part sits there in the world."""
        self._plugs: dict[str, DemoPlace] = {}
        free = [one for one in devices if one.part_number]
        own = tuple(slot.name for slot in blueprint.slots) if names is None else names
        for name, meant_for in {**dict(zip(own, own, strict=True)), **self._spares}.items():
            slot = blueprint.slot(meant_for)
            if slot is None:
                raise ConfigError(
                    f"the demo needs a slot {meant_for!r}; the blueprint has none: use the sample of `msbot init`"
                )
            device = self._take_device(free, slot.part_number) if name in self._bridged else None
            self._plugs[name] = DemoPlace(
                name, meant_for, slot.part_number, self._random.randbytes(8), library, device=device
            )
        for device in free:
            self._add_device(device)
        self._by_uid = {plug.uid: plug for plug in self._plugs.values()}
        self._baseline: dict[str, tuple[int, int]] = {}
        self._tasks: asyncio.TaskGroup | None = None
        self.begun = asyncio.Event()
        """All parts but the spares have been plugged in for the first time."""
        self._finished = asyncio.Event()
        self._final: DemoSnapshot | None = None

    @staticmethod
    def _take_device(free: list[PluggableDevice], part_number: str) -> PluggableDevice | None:
        device = next((one for one in free if one.part_number == part_number), None)
        if device is not None:
            free.remove(device)
        return device

    def _add_device(self, device: PluggableDevice) -> None:
        """A device that has no slot of its own: it stands by."""
        name, number = device.name, 2
        while name in self._plugs:
            name, number = f"{device.name}{number}", number + 1
        self._plugs[name] = DemoPlace(name, "", device.part_number, self._random.randbytes(8), None, device=device)

    @property
    def names(self) -> tuple[str, ...]:
        """The parts of the robot."""
        return tuple(self._plugs)

    async def run(self) -> None:
        """Run the robot with all parts plugged in, until `finish` or cancellation.

        Raises:
            LinkDown: the wire cannot be opened.
        """
        self._started_at = self._loop.time()
        try:
            with ungrouped(MsbotError):
                async with asyncio.TaskGroup() as tasks:
                    self._tasks = tasks
                    background = [tasks.create_task(self.master.run())]
                    if self._door is not None:
                        background.append(tasks.create_task(self._door.run()))
                    await self.master.ready.wait()
                    for name, plug in self._plugs.items():
                        if plug.device is not None and plug.device.is_plugged:
                            plug.plugged_at = self._loop.time()
                        elif plug.device is None and name not in self._spares and name not in self._unplugged:
                            self.plug(name)
                    self.begun.set()
                    self._watch_start()
                    await self._finished.wait()
                    await self._settle()
                    self._final = self._look()
                    for task in background + [plug.task for plug in self._plugs.values() if plug.task is not None]:
                        task.cancel()
        finally:
            self._tasks = None

    @property
    def bus_driver(self) -> SimBusDriver | None:
        """The driver of the simulated bus; None over UDP."""
        return self._wiring.driver

    def on_frame(self, tap: FrameTap) -> None:
        """Call `tap` with every frame on the simulated bus; there are none over UDP."""
        if self._wiring.driver is not None:
            self._wiring.driver.tap = tap

    def on_event(self, listener: Callable[[DemoStateChange], None]) -> None:
        """Call the listener with every change of a part's state."""
        self._event_listeners.append(listener)

    def finish(self) -> None:
        """End `run`."""
        self._finished.set()

    def is_plugged(self, name: str) -> bool:
        """Whether that part is on the wire."""
        plug = self._plug(name)
        return plug.part is not None if plug.device is None else plug.device.is_plugged

    def plug(self, name: str) -> bool:
        """Plug a part in; False: it already is, or the robot does not run, and nothing happens."""
        plug = self._plug(name)
        if plug.part is not None or self._tasks is None:
            return False
        if plug.device is not None:
            plug.plugged_at, plug.active_at = self._loop.time(), None
            return plug.device.plug()
        if name in self._bridged:
            return False  # only the device itself can be there
        part = plug.make(Random(self._random.getrandbits(64)))
        plug.task = self._tasks.create_task(part.run_async(self._connect(plug), epoch_ns=self._epoch_ns))
        self._enter(plug)
        return True

    def plug_program(self, name: str, part: Part, failed: Callable[[Exception], object]) -> bool:
        """Plug in the part of somebody's own program, with the UID of its place; False: see `plug`.

        Args:
            name: the place.
            part: what the program has made; nobody has run it yet.
            failed: called with what has ended the part, if it is a mistake; the robot goes on.
        """
        plug = self._plug(name)
        if plug.part is not None or self._tasks is None:
            return False
        part.uid = plug.uid
        plug.part = part

        async def run(link: Link) -> None:
            try:
                await part.run_async(link, epoch_ns=self._epoch_ns)
            except Exception as error:  # whatever somebody's own program does
                failed(error)
            if plug.part is part:  # it has ended by itself
                self._wiring.pull(name)
                plug.clear()

        plug.task = self._tasks.create_task(run(self._connect(plug)))
        return True

    def _connect(self, plug: DemoPlace) -> Link:
        plug.plugged_at = self._loop.time()
        plug.active_at = None
        return self._wiring.part_link(plug.name, plug.uid)

    def unplug(self, name: str) -> bool:
        """Pull a part out: it is off the wire and without power at once, and says no goodbye; False: it is out."""
        plug = self._plug(name)
        if plug.device is not None:
            return plug.device.unplug()
        if plug.part is None or plug.task is None:
            return False
        self._wiring.pull(name)
        plug.task.cancel()
        plug.clear()
        self._leave(plug)
        return True

    def _enter(self, plug: DemoPlace) -> None:
        """Bring a part into the world, unless another one sits where it would."""
        if self._door is not None and plug.simulated is not None and plug.slot not in self._inside:
            self._inside[plug.slot] = plug.name
            self._door.enter(plug.slot, plug.simulated)

    def _leave(self, plug: DemoPlace) -> None:
        """Take a part out of the world; one that stands by takes its place."""
        if self._door is None or self._inside.get(plug.slot) != plug.name:
            return
        del self._inside[plug.slot]
        self._door.leave(plug.slot)
        for other in self._plugs.values():
            if other.slot == plug.slot:
                self._enter(other)

    def uid(self, name: str) -> bytes:
        """The UID of that part, plugged in or not."""
        return self._plug(name).uid

    def simulated(self, name: str) -> SimulatedPart | None:
        """The simulated device plugged in there, to be played with; None for the thesis' three and an empty place."""
        return self._plug(name).simulated

    def board(self, name: str) -> SimGpio:
        """The GPIO board of one of the thesis' three; that of BB is driven by AA."""
        return self._plug(name).board

    def snapshot(self) -> DemoSnapshot:
        """The state of the robot now, or when it ended."""
        return self._final or self._look()

    async def _settle(self) -> None:
        """Let samples that are on their way arrive, so that the final count does not report them as lost."""
        for _ in range(SETTLE_LOOKS):
            if all(topic.delivered >= topic.published for topic in self._topic_snapshots()):
                return
            await asyncio.sleep(SETTLE_S / SETTLE_LOOKS)

    def _look(self) -> DemoSnapshot:
        now = self._loop.time()
        view = self.master.inventory.view(now)
        infos = {info.uid: info for info in view}
        holders = {info.slot: info for info in view if info.slot}
        return DemoSnapshot(
            robot=self.master.profile.name,
            link=self._wiring.name,
            at_s=now - self._started_at,
            # A place into which the demo has plugged nothing is for a part that a bridge brings.
            parts=tuple(
                self._part_snapshot(
                    plug, infos.get(plug.uid) if plug.plugged_at is not None else holders.get(plug.slot)
                )
                for plug in self._plugs.values()
            ),
            topics=tuple(self._topic_snapshots()),
            bus=self._bus_snapshot(now),
        )

    def _part_snapshot(self, plug: DemoPlace, info: PartInfo | None) -> PartSnapshot:
        return PartSnapshot(
            name=plug.name,
            part_number=plug.part_number,
            slot=(info.slot or "") if info is not None else "",
            state=info.state.value if info is not None else PartState.NEW.value,
            plugged=self.is_plugged(plug.name),
            life=info.life if info is not None else 0,
            beat_age_s=info.beat_age_s if info is not None else None,
            beats=info.beats if info is not None else 0,
            messages_in=plug.messages_in,
            messages_out=plug.messages_out,
            plug_in_to_active_ms=plug.to_active_ms,
            outputs=tuple(plug.board.levels()),
        )

    def _topic_snapshots(self) -> list[TopicSnapshot]:
        snapshots = []
        for name, (published, delivered) in self._traffic().items():
            published_before, delivered_before = self._baseline.get(name, (published, delivered))
            snapshots.append(TopicSnapshot(name, published - published_before, delivered - delivered_before))
        return snapshots

    def _traffic(self) -> dict[str, tuple[int, int]]:
        """Samples accepted by the agent and samples that arrived in the parts, by topic, since the start."""
        accepted = {name: published for name, published, _ in self.master.agent.topics()}
        return {
            binding.topic: (
                accepted.get(binding.topic, 0),
                sum(
                    plug.messages_in
                    for target in binding.targets
                    for plug in self._plugs.values()
                    if plug.slot == target.slot
                ),
            )
            for binding in self.master.blueprint.bindings
        }

    def _bus_snapshot(self, now: float) -> BusSnapshot | None:
        driver = self._wiring.driver
        if driver is None:
            return None
        bus = driver.bus
        return BusSnapshot(
            bitrate=bus.bitrate,
            frames=bus.counters.frames,
            bits=bus.counters.bits,
            load_percent=100 * bus.counters.busy_s / max(now - self._started_at, bus.counters.busy_s, 1e-9),
            load_now_percent=100 * bus.load(now),
            errors=bus.counters.errors,
        )

    def _changed(self, event: PartEvent) -> None:
        if self._final is not None:
            return  # the end of the robot itself is no news
        plug = self._by_uid.get(event.uid) or self._device_of(event)
        name = plug.name if plug is not None else event.slot or event.part
        if plug is not None and event.to_state is PartState.ACTIVE and plug.active_at is None:
            plug.active_at = event.at
        shown = DemoStateChange(
            at_s=event.at - self._started_at,
            part=name,
            from_state="" if event.from_state is None else event.from_state.value,
            to_state=event.to_state.value,
            reason=event.reason,
            slot=event.slot or "",
        )
        self.events.append(shown)
        for listener in self._event_listeners:
            listener(shown)

    def _device_of(self, event: PartEvent) -> DemoPlace | None:
        """The place of a device whose part has come for the first time; its UID is known from then on."""
        for plug in self._plugs.values() if event.uid else ():
            if plug.device is not None and not plug.is_uid_known and plug.part_number == event.part_number:
                plug.is_uid_known, plug.uid = True, event.uid
                self._by_uid[event.uid] = plug
                return plug
        return None

    def _watch_start(self) -> None:
        """Count traffic from the first moment when every part of the ring can hear its partner."""
        ends = [end for binding in self.master.blueprint.bindings for end in binding.ends]
        wanted = sum(end.slot in self._plugs and end.slot not in self._unplugged for end in ends)
        topics = {binding.topic for binding in self.master.blueprint.bindings}
        attached = sum(
            endpoint.attached and endpoint.kind != "topic" and endpoint.topic in topics
            for client in self.master.agent.clients()
            for endpoint in client.objects
        )
        if attached >= wanted:
            # A sample that the agent has sent and no part has received yet counts as neither published nor delivered.
            self._baseline = {name: (published, out) for name, published, out in self.master.agent.topics()}
            for name in self._spares:
                self.plug(name)
        else:
            self._loop.call_later(START_LOOK_S, self._watch_start)

    def _plug(self, name: str) -> DemoPlace:
        plug = self._plugs.get(name)
        if plug is None:
            raise ConfigError(f"there is no part {name!r} in the demo; there are {', '.join(self._plugs)}")
        return plug
