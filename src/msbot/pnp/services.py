"""The master's profile and the inventory as clients of the agent: parts of the robot like any other (R2, R3).

Both use `msbot.part.Client` over any link; in a master it is the in-process link, which makes them trusted
(`msbot.pnp.access`). What they say is decided elsewhere: `profile`, `requests`, `inventory`.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable

from msbot.agent import client_key_of
from msbot.errors import LinkFull, LocalProtocolError, RequestError
from msbot.part import Client, ClientMaker, ConnectionState, Entity, ServiceNames
from msbot.part.join import plug
from msbot.pnp import thesis_programs as compat
from msbot.pnp.emergency_stop import EmergencyStop
from msbot.pnp.inventory import Inventory
from msbot.pnp.key_proof import Keys
from msbot.pnp.model import Configuration, Verdict
from msbot.pnp.part_events import PartEvent, PartState
from msbot.pnp.profile import PROFILE_PERIOD_S, PROFILE_TOPIC, PROFILE_TYPE, Profile
from msbot.pnp.requests import RequestHandler, verdict_message
from msbot.xrce.messages import STREAM_BEST_EFFORT, STREAM_RELIABLE
from msbot.xrce.objects import EndpointQos

STATUS_TIMEOUT_S = 5.0
"""How long the agent may take to create what a service needs before it is asked again."""

LONGEST_BEST_EFFORT = 512
"""Answers up to this many octets go best effort: they need no window, and a part repeats an unanswered request. Longer
ones (configurations) go reliably, because only a reliable stream can split them into packets."""

MOST_ASKERS = 16_384
"""Most parts that can be told something unasked; any further part finds out with its next beat."""

_GUID_BYTES = 16
_NOBODYS_REQUEST = bytes(8)
"""Sequence number 0: the reply answers no request."""
GO_TIMES = 3
"""GO is repeated with this many answers to beats, in case one is lost; STOP with every one until the part confirms."""

_COMPACT = ServiceNames(plug.INVENTORY_SERVICE, plug.INVENTORY_REQUEST_TYPE, plug.INVENTORY_REPLY_TYPE)
_COMPAT = ServiceNames(compat.SERVICE, compat.REQUEST_TYPE, compat.REPLY_TYPE)

_log = logging.getLogger(__name__)


class MasterService:
    """Step 1: publishes the robot's profile, latched and repeated every period (thesis 3.12.1, R44).

    Args:
        make_client: makes the client that speaks for the master, called with the callbacks that it needs.
        profile: what is published.
        period_s: seconds between two publications.
        limit: number of publications after which it falls silent (the thesis' count limit); None = never.
    """

    def __init__(
        self,
        make_client: ClientMaker,
        profile: Profile,
        *,
        period_s: float = PROFILE_PERIOD_S,
        limit: int | None = None,
    ) -> None:
        self.profile = profile
        self.published = 0
        """Publications so far; also the count in the profile."""
        self._client = client = make_client(on_state=self._state_changed)
        self._period_s = period_s
        self._limit = limit
        self._opened = asyncio.Event()
        participant = client.create_participant("msbot_master")
        publisher = client.create_publisher(participant)
        topic = client.create_topic(participant, PROFILE_TOPIC, PROFILE_TYPE)
        self._writer = client.create_writer(publisher, topic, EndpointQos(transient_local=True, depth=1))

    async def run(self) -> None:
        """Serve until cancelled.

        Raises:
            LinkDown: the link to the agent cannot be opened.
        """
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._client.run())
            tasks.create_task(self._publish_for_ever())

    async def _publish_for_ever(self) -> None:
        while self._limit is None or self.published < self._limit:
            await self._client.connect()
            self._opened.clear()
            if not await _is_ready(self._client):
                continue
            self._publish()
            try:
                async with asyncio.timeout(self._period_s):
                    await self._opened.wait()
            except TimeoutError:
                continue

    def _publish(self) -> None:
        self.published += 1
        try:
            self._client.write(self._writer, profile_message(self.profile, self.published).encode())
        except (LinkFull, LocalProtocolError) as error:
            _log.warning("the profile could not be published: %s", error)

    def _state_changed(self, state: ConnectionState, reason: str) -> None:
        _log.debug("master: %s: %s", state.value, reason)
        if state is ConnectionState.CONNECTED:
            self._opened.set()


class InventoryService:
    """Step 2: answers claims, beats and requests for configurations in both layouts, and drives the life timer.

    It also speaks unasked, best effort: when a part's configuration has changed, when a standby part has been given a
    slot or a part has lost its own, when nobody publishes to one of its ports any more, and on STOP. Parts that use the
    thesis' own layout cannot be told anything unasked.

    Args:
        make_client: makes the client that speaks for the inventory, called with the callbacks that it needs.
        inventory: decides.
        explain: answer refusals with their reason.
        keys: asks every claim for a proof; None: the robot is open.
        stop: STOP of this robot, which may still hold from an earlier run.
        complete: adds to a configuration what its part needs besides; called whenever one is sent.
    """

    def __init__(
        self,
        make_client: ClientMaker,
        inventory: Inventory,
        *,
        explain: bool = False,
        keys: Keys | None = None,
        stop: EmergencyStop | None = None,
        complete: Callable[[Configuration], Configuration] = lambda configuration: configuration,
    ) -> None:
        self.requests = RequestHandler(inventory, explain=explain, keys=keys, complete=complete)
        self.stop = stop or EmergencyStop()
        """Which STOP holds, and who has confirmed it."""
        self.told_unasked = 0
        """Messages sent to parts that did not ask."""
        self._client = client = make_client(on_request=self._request_received)
        self._askers: dict[int, bytes] = {}
        """Client key -> GUID of its requests in the compact layout."""
        self._leases: dict[int, int] = {}
        """Client key -> the lease that it was last told."""
        self._go_again: dict[int, int] = {}
        """Client key -> how many more times it is told that STOP is over."""
        self._awake_at = 0.0
        """When the inventory's timer is next checked."""
        self._sooner = asyncio.Event()
        """Set when the timer is due before that."""
        self._asking: int | None = None
        """The client whose request is being answered: the answer itself tells it what has changed."""
        self._inventory = inventory
        participant = client.create_participant("msbot_inventory")
        self._compact = client.create_replier(participant, _COMPACT)
        self._compat = client.create_replier(participant, _COMPAT)
        for replier in (self._compact, self._compat):
            client.read(replier, stream_id=STREAM_BEST_EFFORT)
        inventory.on_rights(self._rights_changed)
        inventory.on_partner(self._partner_changed)
        inventory.on_event(self._part_changed)

    async def run(self) -> None:
        """Serve until cancelled.

        Raises:
            LinkDown: the link to the agent cannot be opened.
        """
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._client.run())
            tasks.create_task(self._keep_time())

    async def until_ready(self, timeout_s: float = STATUS_TIMEOUT_S) -> None:
        """Wait until parts can be answered.

        Raises:
            RequestError: not ready within `timeout_s` seconds, or the agent refused the services.
        """
        await self._client.connect(timeout_s)
        await self._client.until_all_statuses(timeout_s)

    async def _keep_time(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            self._sooner.clear()
            self._awake_at = self._inventory.timer()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout_at(self._awake_at):
                    await self._sooner.wait()
            if loop.time() >= self._inventory.timer():
                self._inventory.handle_timer(loop.time())

    def stop_all(self, by: str, reason: str, at_ns: int) -> None:
        """Say STOP to all parts, and to those that join before `go_all`.

        Args:
            by: who says it.
            reason: why; may be empty.
            at_ns: the wall clock, nanoseconds since 1970.
        """
        self.stop.say(by, reason, self._inventory.members(), asyncio.get_running_loop().time(), at_ns)
        self._go_again.clear()
        self._tell_all(plug.NoticeKind.STOP)

    def go_all(self, by: str) -> int:
        """End STOP; returns how many parts that hold a slot were told."""
        self.stop.go(by)
        self._go_again = dict.fromkeys(self._askers, GO_TIMES)
        self._tell_all(plug.NoticeKind.GO)
        return len(self._inventory.members())

    def identify(self, client_key: int) -> bool:
        """Have a part show itself; False: it cannot be told."""
        return self._notify(client_key, plug.NoticeKind.IDENTIFY)

    def _request_received(self, object_id: int, request_id: int, identity: bytes, body: bytes) -> None:  # noqa: ARG002
        self._answer(object_id, identity, body, asyncio.get_running_loop().time())
        if self._inventory.timer() < self._awake_at:
            self._sooner.set()

    def _answer(self, object_id: int, identity: bytes, body: bytes, now: float) -> None:
        asker = identity[:_GUID_BYTES]
        client_key = client_key_of(asker)
        self._asking = client_key
        if object_id != self._compact.object_id:
            answer = self.requests.compat(body, client_key, now)
            self._asking = None
            if answer is not None:
                self._say(self._compat, identity, answer)
            return
        request = self.requests.read(body, client_key, now)
        reply = None if request is None else self.requests.answer(request, client_key, now, asker)
        self._remember(client_key, asker, reply)
        self._asking = None
        if request is not None and self.requests.asks_what(request, client_key):
            self._notify(client_key, plug.NoticeKind.DESCRIBE)
        if request is None or reply is None:
            return
        if isinstance(reply, plug.ConfigurationMessage) and self.stop.holds:
            reply.settings.append(plug.Setting(name=plug.STOP_SETTING, value=str(self.stop.number)))
        octets = self.requests.encode(reply, client_key)
        if octets is not None:
            self._say(self._compact, identity, octets)
        if isinstance(reply, plug.BeatReply) and reply.configuration_version:
            self._speak_of_stop(request, client_key, now)
        elif isinstance(reply, plug.ConfigurationMessage) and self.stop.holds:
            self._notify(client_key, plug.NoticeKind.STOP, self.stop.number)  # for parts that do not read the setting

    def _speak_of_stop(self, beat: plug.Request, client_key: int, now: float) -> None:
        """Take a beat that confirms STOP, or repeat STOP or GO: a single notice may be lost."""
        if self.stop.holds:
            if not self._is_confirmation(beat, client_key, now):
                self._notify(client_key, plug.NoticeKind.STOP, self.stop.number)
        elif isinstance(beat, plug.StoppedBeat):
            self._notify(client_key, plug.NoticeKind.GO, self.stop.number)
        elif left := self._go_again.pop(client_key, 0):
            self._notify(client_key, plug.NoticeKind.GO, self.stop.number)
            if left > 1:
                self._go_again[client_key] = left - 1

    def _is_confirmation(self, beat: plug.Request, client_key: int, now: float) -> bool:
        member = self._inventory.member(client_key)
        if not isinstance(beat, plug.StoppedBeat) or member is None:
            return False
        return self.stop.confirm(member[0], beat.number, now)

    def _part_changed(self, event: PartEvent) -> None:
        if not self.stop.holds:
            return
        identity = event.identity
        if event.to_state is PartState.ACTIVE:
            if event.from_state is not PartState.LATE:
                self.stop.begin_anew(identity, event.part, asyncio.get_running_loop().time())
        elif event.to_state in (PartState.LEFT, PartState.STANDBY, PartState.REFUSED):
            self.stop.leave(identity)

    def _remember(self, client_key: int, asker: bytes, answer: plug.Reply | None) -> None:
        if self._askers.get(client_key) != asker:
            if len(self._askers) >= MOST_ASKERS:
                self._forget(next(iter(self._askers)))
            self._askers[client_key] = asker
            self._leases.pop(client_key, None)
        if isinstance(answer, plug.VerdictMessage):
            before = self._leases.get(client_key)
            self._leases[client_key] = answer.lease
            member = self._inventory.member(client_key)
            if self.stop.holds and before != answer.lease and member is not None:
                self.stop.begin_anew(*member, asyncio.get_running_loop().time())  # the part has restarted

    def _forget(self, client_key: int) -> None:
        self._askers.pop(client_key, None)
        self._leases.pop(client_key, None)
        self._go_again.pop(client_key, None)

    def _rights_changed(self, client_key: int) -> None:
        if client_key == self._asking or client_key not in self._askers:
            return
        standing = self._inventory.standing_of(client_key)
        if standing is None or standing.state in (PartState.NEW, PartState.CHECKING):
            # A session that has ended, or was reopened: its new requester will ask first.
            self._forget(client_key)
        elif not standing.lease:
            self._leases[client_key] = 0
            self._tell(client_key, plug.BeatReply(configuration_version=0))
        elif standing.lease == self._leases.get(client_key):
            self._tell(client_key, plug.BeatReply(configuration_version=standing.configuration_version))
        else:
            self._leases[client_key] = standing.lease
            verdict = Verdict(standing.lease, standing.configuration_version)
            self._tell(client_key, verdict_message(verdict, self._inventory.timing.beat_ms))

    def _partner_changed(self, client_key: int, topic: str, is_there: bool) -> None:
        configuration = self._inventory.configuration_of(client_key)
        if configuration is None:
            return
        kind = plug.NoticeKind.PARTNER_BACK if is_there else plug.NoticeKind.PARTNER_LOST
        for place, binding in enumerate(configuration.bindings):
            if binding.topic == topic and not binding.publishes:
                self._notify(client_key, kind, configuration.version, place)

    def _tell_all(self, kind: plug.NoticeKind) -> None:
        for client_key in list(self._askers):
            self._notify(client_key, kind, self.stop.number)

    def _notify(self, client_key: int, kind: plug.NoticeKind, number: int = 0, binding: int = plug.NO_BINDING) -> bool:
        return self._tell(client_key, plug.Notice(number=number & 0xFFFFFFFF, binding=binding, kind=kind))

    def _tell(self, client_key: int, message: plug.Reply) -> bool:
        asker = self._askers.get(client_key)
        if asker is None:
            return False
        octets = self.requests.encode(message, client_key)
        if octets is None:
            return False
        self.told_unasked += 1
        return self._say(self._compact, asker + _NOBODYS_REQUEST, octets)

    def _say(self, replier: Entity, identity: bytes, answer: bytes) -> bool:
        stream_id = STREAM_BEST_EFFORT if len(answer) <= LONGEST_BEST_EFFORT else STREAM_RELIABLE
        try:
            self._client.reply(replier, identity, answer, stream_id=stream_id)
        except (LinkFull, LocalProtocolError) as error:
            # The part asks again by itself.
            self.requests.dropped.count(f"answer: {error}")
            return False
        return True


def profile_message(profile: Profile, count: int) -> plug.ProfileMessage:
    """The profile as a message; the thesis defines the fields by their position (3.12.1).

    Raises:
        LocalProtocolError: a text in it is too long.
    """
    return plug.ProfileMessage(
        index=count & 0xFFFFFFFF,
        message=profile.name,
        name=profile.version,
        id=profile.serial_number,
        dof=profile.released,
        make=profile.manufacturer,
    )


async def _is_ready(client: Client) -> bool:
    try:
        await client.until_all_statuses(STATUS_TIMEOUT_S)
    except RequestError as error:
        _log.warning("the agent is not ready for the master: %s", error)
        await asyncio.sleep(1.0)
        return False
    return True
