"""The composition root: puts agent, inventory, profile and links together. The only place that knows everybody.

The master and the inventory are clients of the agent like any other (thesis 3.11), over an in-process link; what they
decide reaches the agent through its one hook, the gate.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import random as random_module
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from math import inf
from pathlib import Path
from typing import Protocol, runtime_checkable

from msbot.config import Blueprint, Direction, Library
from msbot.master.board_configuration import with_documents
from msbot.master.stop_persistence import StopStore
from msbot.part import Client
from msbot.part.join.part_log import LogLevel
from msbot.part.join.pnp_messages import range_setting
from msbot.part.messages.type_hash import Fields
from msbot.pnp import Configuration, Inventory, Keys, LifeTiming, PartInfo, PartStore, Profile, RobotGate
from msbot.pnp.emergency_stop import EmergencyStop, StopRecord, StopStatus
from msbot.pnp.inventory_service import InventoryService, in_any_case
from msbot.pnp.master_service import MasterService
from msbot.pnp.remote_agents.agents_service import RemoteAgentsService
from msbot.pnp.type_agreement import difference_sentence
from msbot.stop.socket_names import own_group
from msbot_agent.agent import Agent, AgentSettings
from msbot_agent.link import InprocHub, Link, Peer, Signal
from msbot_agent.link.relay import RelayGreeting
from msbot_agent.process.end_signals import ungrouped
from msbot_agent.space import MemorySpace, Space
from msbot_agent.text.sentence import Sentence, counted, said
from msbot_xrce.errors import ConfigError, LinkDown, LinkFull, MsbotError

_log = logging.getLogger(__name__)

MASTER_KEY = 0x4D734D01
INVENTORY_KEY = 0x4D734D02
AGENTS_KEY = 0x4D734D03
"""Client keys of the robot's own services; the gate refuses them to clients on any other link."""

READY_S = 300.0
"""How long the robot's own agent, in this same process, may take to serve the inventory. Only a slow or busy computer
delays it; to end would be to begin anew, and the same would happen again."""
STORED_S = 2.0
"""Longest time that a person who says STOP waits until it is stored."""
TELL_S = 0.1
"""Parts are not told the same STOP again within this time, however often it is said: notices would displace beats."""
LOG_LINES = 3
"""Warnings and errors of a part's program that `why` shows."""
STORE_S = 1.0
"""Nor is it stored again."""


@runtime_checkable
class StoppableLink(Protocol):
    """A link that can tell all its parts to stop at once."""

    def send_stop(self, reason: int = 0) -> None:
        """Say STOP; raises LinkDown when the link carries nothing."""


class Master:
    """One robot's master: profile, health inventory and agent on any number of links.

    Must be made inside a running event loop, whose clock becomes the robot's clock.
    """

    def __init__(
        self,
        blueprint: Blueprint,
        store: PartStore,
        *,
        space: Space | None = None,
        agent_settings: AgentSettings | None = None,
        random: random_module.Random | None = None,
        epoch_ns: Callable[[], int] = time.time_ns,
        stop_file: Path | None = None,
        is_shared: bool = False,
        library: Library | None = None,
        stop_group: str | None = None,
    ) -> None:
        """Put a master together; it serves once `run` is awaited.

        Args:
            blueprint: what the robot is.
            store: library, slots, configurations and journal: the registry, or memory.
            space: where the agent acts for its clients; memory if absent.
            agent_settings: limits and periods of the agent.
            random: generates leases and identities; the system's source if absent.
            epoch_ns: wall clock for time synchronisation, nanoseconds since 1970.
            stop_file: where STOP is stored in addition to the database, to survive a restart; None: nowhere else.
            is_shared: whether another master may take the robot over: STOP must then be in the database.
            library: the part types; without it, boards are not told what is wired to them.
            stop_group: its STOP group; None: as `$MSBOT_STOP_GROUP` says, or else the blueprint.

        Raises:
            ConfigError: the timing makes no sense.
            RegistryError: the slots cannot be read.
        """
        loop = asyncio.get_running_loop()
        self._clock = loop.time
        dice = random or random_module.SystemRandom()
        self.blueprint = blueprint
        self._stop_group = stop_group
        self.library = library
        """The part types: what the parts of boards need to know."""
        self.profile = profile_of(blueprint)
        self.inventory = Inventory(store, random=dice, now=loop.time(), timing=timing_of(blueprint))
        self.access = RobotGate(self.inventory, clock=loop.time, free_topics=frozenset(blueprint.options.free_topics))
        self.space = space or MemorySpace(clock=loop.time)
        """Where the robot's topics are."""
        self.agent = Agent(
            self.space,
            gate=self.access,
            settings=agent_settings,
            epoch_ns=epoch_ns,
            agent_id=dice.randbytes(8),
            signal=self._link_signalled,
            relay_greeting=RelayGreeting(self.profile.profile_hash()),
        )
        self.inventory.types.library_fields = self._fields_of_type
        self.inventory.on_rights(self.agent.recheck)
        self.inventory.on_superseded(self._superseded)
        self.inventory.watch.use_agent(last_heard=self._last_heard, probe=self._probe)
        self._board_faults: dict[str, list[str]] = {}
        """Slot of a board -> what is wrong with what is wired to it."""
        self._witnesses: list[Callable[[PartInfo], Sequence[str]]] = []
        self._stop_listeners: list[Callable[[StopStatus], object]] = []
        self._go_refusals: list[Callable[[], str]] = []
        self._speech_listeners: list[Callable[[bool, str, str, str], object]] = []
        self._epoch_ns = epoch_ns
        self._keeper = StopStore(store, stop_file, is_shared=is_shared)
        self._stop = EmergencyStop(self._keeper.load())
        self._kept = self._stop.record
        """The latest record of STOP of which it is known whether it is stored."""
        self._stop_trouble = ""
        self._stop_is_stored = asyncio.Event()
        self._stop_is_stored.set()
        self._told_at = self._stored_at = -inf
        """When parts were told of STOP last, and when it was handed over for storing."""
        if self._stop.holds:
            self._keep_stop()
        self.ready = asyncio.Event()
        """Set when the robot's own services answer and every link is open."""
        self._serving = False
        self._opening: set[str] = set()
        hub = InprocHub()
        self.agent.add_link(hub.server)
        self._links: list[Link] = []
        self._master = MasterService(
            partial(Client, hub.connect(), key=MASTER_KEY, epoch_ns=epoch_ns, random=dice),
            self.profile,
            period_s=blueprint.timing.profile_period_s,
        )
        self._inventory = InventoryService(
            partial(Client, hub.connect(), key=INVENTORY_KEY, epoch_ns=epoch_ns, random=dice),
            self.inventory,
            explain=blueprint.options.explain,
            keys=_keys_of(blueprint, store, dice),
            stop=self._stop,
            on_stop=self.say_stop,
            complete=self._complete,
        )

        sealed = blueprint.options.authentication == "key+data"
        self._agents = RemoteAgentsService(
            partial(Client, hub.connect(), key=AGENTS_KEY, epoch_ns=epoch_ns, random=dice),
            access=self.access,
            inventory=self.inventory,
            services=self._inventory,
            profile=self.profile,
            stop=self._stop,
            random=dice,
            sealed=sealed,
            on_stop=self._stop_said_at_agent,
            on_topics=self.agent.recheck,
            say=partial(_log.warning, "%s"),
        )
        self._inventory.use_elsewhere(self._agents.end)
        self.access.use_agents(self._agents.end, self._agents.agent_left)

    @property
    def is_serving(self) -> bool:
        """Whether parts are served: `run` has begun and is not ending yet."""
        return self._serving

    @property
    def inventory_service(self) -> InventoryService:
        """The service that answers the parts, and speaks to them unasked."""
        return self._inventory

    @property
    def links(self) -> tuple[Link, ...]:
        """The links by which parts come in."""
        return tuple(self._links)

    def _superseded(self, client_key: int) -> None:
        reason = "its part came back from another address"
        if self._agents.end.has(client_key):
            self._agents.end.close(client_key, reason)
        else:
            self.agent.disconnect(client_key, reason)

    def _last_heard(self, client_key: int) -> float | None:
        elsewhere = self._agents.end
        return elsewhere.heard_at(client_key) if elsewhere.has(client_key) else self.agent.last_heard(client_key)

    def _probe(self, client_key: int) -> None:
        self._agents.end.probe(client_key)
        self.agent.probe(client_key)

    def why(self, part: str, *, by_name: bool = False) -> list[str]:
        """The state of a part, the rules that led to it, and whom its topics cannot reach, in sentences."""
        lines = self.inventory.why(part, self._clock(), by_name=by_name)
        stop: list[str] = []
        if self.stop.stopped and any(one.slot for one in self.inventory.find(part, self._clock(), by_name=by_name)):
            stop = [said("STOP is in force: no message reaches its functions until GO")]
        return [*lines, *stop, *self.troubles(part, by_name=by_name), *self.program_lines(part, by_name=by_name)]

    def program_lines(self, part: str, *levels: LogLevel, by_name: bool = False) -> list[Sentence]:
        """What its program logged last of these levels; none given: of all but information."""
        found = self.inventory.find(part, self._clock(), by_name=by_name)
        logged = [line for info in found if info.slot for line in self.inventory.lines_of(info.slot)]
        wanted = levels or (LogLevel.WARNING, LogLevel.ERROR)
        lines = [line for line in logged if line.level in wanted][-LOG_LINES:]
        return [said("its program says: {words}", words=line.words) for line in lines]

    def troubles(self, part: str, *, by_name: bool = False) -> list[str]:
        """Endpoints that should match a part's topics now and cannot, one sentence each, naming the DDS policy."""
        found = self.inventory.find(part, self._clock(), by_name=by_name)
        of_boards = [fault for info in found for fault in self._board_faults.get(info.slot or "", ())]
        worn = [words for info in found for words in self._wear(info)]
        told = [words for info in found for witness in self._witnesses for words in witness(info)]
        return [
            *of_boards,
            *(trouble for info in found for trouble in self.agent.troubles(info.client_key)),
            *(words for info in found for words in self.type_differences(info.client_key)),
            *(words for info in found for words in self._adopt_anew(info)),
            *worn,
            *told,
        ]

    def _fields_of_type(self, type_name: str) -> Fields | None:
        """The fields of a message type of the library; it may learn types while the robot runs."""
        messages = {} if self.library is None else self.library.messages
        known = messages.get(type_name)
        if known is not None:
            return known.described()[type_name]
        inside = (one.described() for one in messages.values())  # an enum is known by those that have it
        return next((types[type_name] for types in inside if type_name in types), None)

    def type_differences(self, client_key: int) -> list[Sentence]:
        """Where a part's program and the library mean different messages, one sentence for each port."""
        return [difference_sentence(one) for one in self.inventory.type_differences(client_key)]

    def _adopt_anew(self, info: PartInfo) -> Sequence[str]:
        """How the library takes the messages of a program that has changed since its part was adopted."""
        part_type = None if self.library is None else self.library.find(info.part_number)
        if part_type is None or not part_type.origin or not info.slot or not self.type_differences(info.client_key):
            return ()
        return (said("if the program is right: msbot adopt {slot}; the wires that still fit stay", slot=info.slot),)

    def all_type_differences(self) -> list[tuple[str, Sentence]]:
        """The same of all parts, with their names."""
        return [(part, difference_sentence(one)) for part, one in self.inventory.all_type_differences()]

    def on_why(self, witness: Callable[[PartInfo], Sequence[str]]) -> None:
        """Ask the witness, too, what there is to say about a part."""
        self._witnesses.append(witness)

    def _wear(self, info: PartInfo) -> Sequence[str]:
        """What went wrong between the agent and a part in its present session."""
        wear = self.agent.wear(info.client_key) if info.state.is_registered else None
        if wear is None:
            return ()
        sentences = []
        if wear.repeated:
            sentences.append(said("{count} of its messages came twice or too late", count=wear.repeated))
        if wear.resent:
            sentences.append(
                counted(wear.resent, "{count} message was sent to it again", "{count} messages were sent to it again")
            )
        if wear.unread:
            sentences.append(
                counted(
                    wear.unread,
                    "{count} sample for it was thrown away: it takes them too slowly",
                    "{count} samples for it were thrown away: it takes them too slowly",
                )
            )
        return sentences

    def _complete(self, configuration: Configuration) -> Configuration:
        """The configuration of a board with what it needs to know of the parts that are wired to it."""
        slot = configuration.slot
        completed, faults = with_documents(configuration, self.inventory.slots.number_of(slot), self.library)
        if faults and self._board_faults.get(slot) != faults:
            for fault in faults:
                _log.warning("%s: %s", slot, fault)
        self._board_faults[slot] = faults
        ranges = self._ranges(completed)
        return replace(completed, settings=(*completed.settings, *ranges)) if ranges else completed

    def _ranges(self, configuration: Configuration) -> list[tuple[str, str]]:
        """The ranges of what a part publishes, as settings `PORT.range.FIELD`."""
        number = self.inventory.slots.number_of(configuration.slot)
        part_type = None if self.library is None else self.library.find(number)
        bound = {one.port for one in configuration.bindings if one.publishes}
        return [
            (range_setting(port.name, field), f"{least:g} {most:g}")
            for port in (() if part_type is None else part_type.ports)
            if port.direction is Direction.PUBLISH and port.name in bound
            for field, (least, most) in port.ranges.items()
        ]

    @property
    def stop(self) -> StopStatus:
        """The state of STOP: who said it and when, which parts have confirmed it after how many ms, which have not."""
        is_stored = not self._kept.is_newer_than(self._stop.record) and not self._stop.record.is_newer_than(self._kept)
        return self._stop.status(is_stored=is_stored, trouble=self._stop_trouble if is_stored else "")

    @property
    def stop_group(self) -> str:
        """The STOP group that it is in: a STOP for another one does not reach it; empty: none."""
        given = self._stop_group
        return (own_group() or self.blueprint.robot.stop_group) if given is None else given

    def say_stop(self, by: str, reason: str = "", place: str = "") -> StopStatus:
        """Say STOP: every part goes to its safe state and stays there until `say_go`.

        That also holds when this master ends, unless STOP could not be stored (`StopStatus.trouble`).

        On a CAN bus this is a frame with priority over all others; the inventory also tells every part again and again
        until it has confirmed. `until_stop_is_stored` waits until STOP is stored.

        However often it is said, it holds; but parts are told, and it is stored, a few times a second at most.
        """
        now = self._clock()
        held = self._stop.holds
        tell = not held or now - self._told_at >= TELL_S
        if tell:
            self._told_at = now
            for link in self.agent.links:
                if isinstance(link, StoppableLink):
                    in_any_case(_say_on, link)
        is_news = self._inventory.stop_all(by, reason, self._epoch_ns(), tell=tell, place=place)
        if not held or self._stop_trouble or now - self._stored_at >= STORE_S:
            self._keep_stop()
        return self._stop_said(by, reason, place, is_news=is_news)

    def say_go(self, by: str, number: int | None = None) -> int:
        """End STOP; returns how many parts were told.

        Args:
            by: who says it.
            number: of the latest STOP that this person knows of; None: whichever holds.

        Raises:
            ConfigError: nobody said STOP, or not that one, somebody has said another since, or a part or a bigger robot
                still says it.
        """
        if not self._stop.holds:
            raise ConfigError(said("nobody said STOP: there is nothing to end"))
        if self._stop.sayers:
            raise ConfigError(
                said(
                    "STOP is still said by {parts}: release the STOP button there, then say GO again",
                    parts=", ".join(self._stop.sayers),
                )
            )
        if why := next(filter(None, (refuses() for refuses in self._go_refusals)), ""):
            raise ConfigError(why)
        if number is not None and number < self._stop.latest:
            raise ConfigError(
                said(
                    "STOP {number} is not the latest: STOP {latest} was said since; see why, and say GO again",
                    number=number,
                    latest=self._stop.latest,
                )
            )
        if number is not None and number > self._stop.latest:
            raise ConfigError(
                said(
                    "there was no STOP {number}: the latest is STOP {latest}; see why, and say GO again",
                    number=number,
                    latest=self._stop.latest,
                )
            )
        told = self._inventory.go_all(by)
        self._keep_stop()
        self._stop_said(by, "", "", is_news=True)
        return told

    async def until_stop_is_stored(self, timeout_s: float = STORED_S) -> StopStatus:
        """Wait until the latest STOP or GO is stored, or cannot be; the answer says which."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):
                await self._stop_is_stored.wait()
        return self.stop

    def _keep_stop(self) -> None:
        self._stored_at = self._clock()
        self._stop_is_stored.clear()
        loop = asyncio.get_running_loop()

        def stored(record: StopRecord, trouble: str) -> None:
            with contextlib.suppress(RuntimeError):  # the robot has ended in the meantime
                loop.call_soon_threadsafe(self._stop_stored, record, trouble)

        self._keeper.store(self._stop.record, stored)

    def _stop_said(self, by: str, reason: str, place: str, *, is_news: bool) -> StopStatus:
        status = self.stop
        for speech_listener in self._speech_listeners:
            in_any_case(speech_listener, status.stopped, by, reason, place)
        for listener in self._stop_listeners if is_news else ():
            in_any_case(listener, status)
        return status

    def _stop_stored(self, record: StopRecord, trouble: str) -> None:
        self._kept, self._stop_trouble = record, trouble
        if not self._stop.record.is_newer_than(record):
            self._stop_is_stored.set()
            self._inventory.stop_was_stored()

    def on_stop(self, listener: Callable[[StopStatus], object]) -> None:
        """Call the listener after every GO, and every STOP that tells something new: not when a person repeats it."""
        self._stop_listeners.append(listener)

    def refuse_go(self, why: Callable[[], str]) -> None:
        """Ask before every GO why nobody may say it now; an empty text: nothing is in the way."""
        self._go_refusals.append(why)

    def on_stop_said(self, listener: Callable[[bool, str, str, str], object]) -> None:
        """Call the listener after every STOP (true) and GO (false) with who has said it just now,
        why, and from where.

        Where one says STOP while that of another holds, the status goes on naming the other.
        """
        self._speech_listeners.append(listener)

    def add_link(self, link: Link) -> None:
        """Add a link by which parts can come in; before or during `run`."""
        self._links.append(link)
        if self._serving:
            self._serve(link)

    async def run(self) -> None:
        """Serve until cancelled.

        Raises:
            LinkDown: a link cannot be opened; the text names the remedy.
        """
        try:
            with ungrouped(MsbotError):
                async with asyncio.TaskGroup() as tasks:
                    tasks.create_task(self.agent.run())
                    tasks.create_task(self._inventory.run())
                    tasks.create_task(self._master.run())
                    tasks.create_task(self._agents.run())
                    # No part is let in before the services can answer it.
                    await self._inventory.until_ready(READY_S)
                    self._serving = True
                    for link in self._links:
                        self._serve(link)
        finally:
            self._serving = False
            self.ready.clear()
            self._keeper.close()

    def _serve(self, link: Link) -> None:
        self._opening.add(link.info.name)
        self.agent.add_link(link)

    def _link_signalled(self, link: Link, signal: Signal, peer: Peer | None, reason: str, now: float) -> None:
        if signal is Signal.LINK_UP and link.info.name in self._opening:
            self._opening.discard(link.info.name)
            if not self._opening:
                self.ready.set()
        elif signal is Signal.STOP and not self._stop.holds:
            # Once: a STOP that is repeated need not be recorded each time, and two masters on one bus must not set each
            # other off.
            self.say_stop("somebody at the robot", f"{reason}, said on {link.info.name}")
        elif signal is Signal.PEER_JOINED:
            self.access.peer_joined(link.info.name, peer, now)

    def _stop_said_at_agent(self, agent: str, words: str) -> None:
        if not self._stop.holds:
            self.say_stop("somebody at the robot", f"{words}, at agent {agent}")


def _say_on(link: StoppableLink) -> None:
    # A bus that is down now carries no orders to move either; a relay is told again with its next beat.
    with contextlib.suppress(LinkDown, LinkFull):
        link.send_stop()


def _keys_of(blueprint: Blueprint, store: PartStore, dice: random_module.Random) -> Keys | None:
    authentication = blueprint.options.authentication
    return None if authentication == "open" else Keys(store, dice, sealed=authentication == "key+data")


def profile_of(blueprint: Blueprint) -> Profile:
    """What the master publishes about a robot."""
    robot = blueprint.robot
    return Profile(
        name=robot.name,
        version=robot.version,
        serial_number=robot.serial_number,
        released=robot.released,
        manufacturer=robot.manufacturer,
    )


def timing_of(blueprint: Blueprint) -> LifeTiming:
    """The robot's periods in the form that the inventory uses."""
    timing = blueprint.timing
    return LifeTiming(beat_s=timing.beat_period_s, tick_s=timing.tick_period_s, life=timing.life)
