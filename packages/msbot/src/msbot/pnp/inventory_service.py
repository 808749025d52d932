"""Step 2: the inventory as a client of the agent, a part of the robot like any other (R2, R3).

It uses `msbot.part.Client` over any link; in a master it is the in-process link, which makes it trusted
(`msbot.pnp.robot_gate`). What it says is decided elsewhere: `requests`, `inventory`.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable
from typing import ParamSpec, Protocol

from msbot.part import ClientMaker, Entity, ServiceNames
from msbot.part.join import pnp_messages, thesis_messages
from msbot.pnp.emergency_stop import EmergencyStop
from msbot.pnp.inventory import Inventory
from msbot.pnp.key_proof import Keys
from msbot.pnp.master_service import STATUS_TIMEOUT_S
from msbot.pnp.model import Configuration, Verdict
from msbot.pnp.part_events import PartEvent, PartState
from msbot.pnp.refusal_help import help_message
from msbot.pnp.requests import RequestHandler, verdict_message
from msbot_agent.agent import client_key_of
from msbot_agent.text.sentence import said
from msbot_xrce.errors import LinkFull, LocalProtocolError
from msbot_xrce.messages import STREAM_BEST_EFFORT, STREAM_RELIABLE

# For what must be gone through to its end: a step that fails is logged, and the next one is taken.


_P = ParamSpec("_P")
_log = logging.getLogger(__name__)


def in_any_case(step: Callable[_P, object], *arguments: _P.args, **named: _P.kwargs) -> None:
    """Take a step of which no failure may keep the caller from its next one; the log has the failure."""
    try:
        step(*arguments, **named)
    except Exception:
        _log.exception("this failed, and what comes after it is done all the same")


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
TOLD_IN_TURN = 10
"""Simulated parts that are told of STOP or GO in one turn of the loop; the first ones at once."""
ANSWERED_S, LATEST_S = 0.01, 0.1
"""The others are told so long after STOP was stored, but not later than so long after it was said, seconds."""

_COMPACT = ServiceNames(
    pnp_messages.INVENTORY_SERVICE, pnp_messages.INVENTORY_REQUEST_TYPE, pnp_messages.INVENTORY_REPLY_TYPE
)
_COMPAT = ServiceNames(thesis_messages.SERVICE, thesis_messages.REQUEST_TYPE, thesis_messages.REPLY_TYPE)


def _notice(
    kind: pnp_messages.NoticeKind, number: int = 0, binding: int = pnp_messages.NO_BINDING
) -> pnp_messages.Notice:
    return pnp_messages.Notice(number=number & 0xFFFFFFFF, binding=binding, kind=kind)


class RemoteParts(Protocol):
    """Parts at agents elsewhere; `remote_agents.MasterSide` provides it."""

    def has(self, key: int) -> bool:
        """Whether the session with that key is at such an agent."""

    def answer(self, key: int, *, in_compat: bool, identity: bytes, body: bytes) -> bool:
        """Say something to a part; False: it is at none of them."""

    def tell_stop(self) -> None:
        """STOP or GO was said: the agents tell their parts."""


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
        on_stop: called with the name of a part that says STOP by itself, and why; STOP then has to be said.
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
        on_stop: Callable[[str, str], object] = lambda _part, _words: None,
        complete: Callable[[Configuration], Configuration] = lambda configuration: configuration,
    ) -> None:
        self.requests = RequestHandler(inventory, explain=explain, keys=keys, complete=complete)
        self.stop = stop or EmergencyStop()
        """Which STOP holds, and who has confirmed it."""
        self.told_unasked = 0
        """Messages sent to parts that did not ask."""
        self._on_stop = on_stop
        self._client = client = make_client(on_request=self._request_received)
        self._elsewhere: RemoteParts | None = None
        self._askers: dict[int, bytes] = {}
        """Client key -> GUID of its requests in the compact layout."""
        self._helped: dict[int, str] = {}
        """Client key -> what a part that is not let in was told last."""
        self._leases: dict[int, int] = {}
        """Client key -> the lease that it was last told."""
        self._go_again: dict[int, int] = {}
        """Client key -> how many more times it is told that STOP is over."""
        self._to_tell: tuple[pnp_messages.Notice, deque[int]] = _notice(pnp_messages.NoticeKind.GO), deque()
        """What simulated parts are still to be told, and which."""
        self._rest: asyncio.TimerHandle | None = None
        """When the first ten of them were told: the others wait for this."""
        self._awake_at = 0.0
        """When the inventory's timer is next checked."""
        self._look = asyncio.Event()
        """Set when the timer is due: at that time, or before."""
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
            self._look.clear()
            self._awake_at = self._inventory.timer()
            alarm = loop.call_at(self._awake_at, self._look.set)
            try:
                await self._look.wait()
            finally:
                alarm.cancel()
            now = loop.time()
            if now >= self._inventory.timer():
                # A loop that rounds its timers has not called too late by that.
                self._inventory.handle_timer(now, max(0.0, now - alarm.when()))

    def stop_all(self, by: str, reason: str, at_ns: int, *, tell: bool = True, place: str = "") -> bool:
        """Say STOP to all parts, and to those that join before `go_all`.

        False: that person has said it already, and it holds.

        Args:
            by: who says it.
            reason: why; may be empty.
            at_ns: the wall clock, nanoseconds since 1970.
            tell: whether to tell the parts, who may have been told a moment ago.
            place: from where it is said, in words; may be empty.
        """
        now = asyncio.get_running_loop().time()
        is_news = self.stop.say(by, reason, self._inventory.members(), now, at_ns, place=place)
        if tell:
            self._tell_all(pnp_messages.NoticeKind.STOP)
        return is_news

    def go_all(self, by: str) -> int:
        """End STOP; returns how many parts that hold a slot were told."""
        self.stop.go(by)
        self._go_again = dict.fromkeys(self._askers, GO_TIMES)
        self._tell_all(pnp_messages.NoticeKind.GO)
        return len(self._inventory.members())

    def identify(self, client_key: int) -> bool:
        """Have a part show itself; False: it cannot be told."""
        return self._notify(client_key, pnp_messages.NoticeKind.IDENTIFY)

    def ask_what(self, client_key: int) -> bool:
        """Ask a part what it is; False: it cannot be told anything."""
        return self._notify(client_key, pnp_messages.NoticeKind.DESCRIBE)

    def use_elsewhere(self, parts: RemoteParts) -> None:
        """Parts may be at agents elsewhere."""
        self._elsewhere = parts

    def request_from_elsewhere(self, key: int, *, in_compat: bool, identity: bytes, body: bytes) -> None:
        """A part at an agent elsewhere asks.

        Args:
            key: of its session here.
            in_compat: in the layout of the thesis' own programs.
            identity: of its request there, which the answer needs.
            body: the request.
        """
        self._asked(key, in_compat=in_compat, identity=identity, body=body)

    def _request_received(self, object_id: int, request_id: int, identity: bytes, body: bytes) -> None:  # noqa: ARG002
        in_compat = object_id != self._compact.object_id
        self._asked(client_key_of(identity[:_GUID_BYTES]), in_compat=in_compat, identity=identity, body=body)

    def _asked(self, client_key: int, *, in_compat: bool, identity: bytes, body: bytes) -> None:
        now = asyncio.get_running_loop().time()
        if in_compat:
            self._answer_in_compat(client_key, identity, body, now)
        else:
            self._answer(client_key, identity, body, now)
        if self._inventory.timer() < self._awake_at:
            self._look.set()

    def _answer_in_compat(self, client_key: int, identity: bytes, body: bytes, now: float) -> None:
        self._asking = client_key
        answer = self.requests.compat(body, client_key, now)
        self._asking = None
        if answer is not None:
            self._say(client_key, identity, answer, in_compat=True)

    def _answer(self, client_key: int, identity: bytes, body: bytes, now: float) -> None:
        asker = identity[:_GUID_BYTES]
        self._asking = client_key
        request = self.requests.read(body, client_key, now)
        reply = None if request is None else self.requests.answer(request, client_key, now, asker)
        self._remember(client_key, asker, reply)
        self._asking = None
        for notice in self.requests.fields_told(request, client_key, now):
            self._tell(client_key, notice)
        if request is not None and self.requests.asks_what(request, client_key):
            self._notify(client_key, pnp_messages.NoticeKind.DESCRIBE)
        if request is None or reply is None:
            return
        if isinstance(reply, pnp_messages.ConfigurationMessage) and self.stop.holds:
            reply.settings.append(
                pnp_messages.Setting(name=pnp_messages.STOP_SETTING, value=str(self.stop.stop_number))
            )
        octets = self.requests.encode(reply, client_key)
        if octets is not None:
            self._say(client_key, identity, octets)
        if isinstance(reply, pnp_messages.VerdictMessage) and not reply.lease:
            self._help(client_key)
        if isinstance(reply, pnp_messages.BeatReply) and reply.configuration_version:
            self._speak_of_stop(request, client_key, now)
        elif isinstance(reply, pnp_messages.ConfigurationMessage) and self.stop.holds:
            self._notify(
                client_key, pnp_messages.NoticeKind.STOP, self.stop.stop_number
            )  # for parts that do not read the setting

    def _help(self, client_key: int) -> None:
        """Tell a part that is not let in what helps, when that is news."""
        words = self._inventory.refusal_help(client_key)
        if words is None or self._helped.get(client_key) == words or self._inventory.seals.of(client_key) is not None:
            return  # what is sealed can be read only once there is a lease
        self._helped[client_key] = words
        self._tell(client_key, help_message(words))

    def _speak_of_stop(self, beat: pnp_messages.Request, client_key: int, now: float) -> None:
        """Take a beat that says or confirms STOP, or repeat STOP or GO: a single notice may be lost."""
        number = beat.number if isinstance(beat, pnp_messages.StoppedBeat) else None
        member = self._inventory.member(client_key)
        if member is not None and self.stop.handle_beat(*member, number):
            self._on_stop(member[1], _why_said(number))
        elif self.stop.holds:
            if member is None or number is None or not self.stop.confirm(member[0], number, now):
                self._notify(client_key, pnp_messages.NoticeKind.STOP, self.stop.stop_number)
        elif number is not None:
            self._notify(client_key, pnp_messages.NoticeKind.GO, self.stop.stop_number)
        elif left := self._go_again.pop(client_key, 0):
            self._notify(client_key, pnp_messages.NoticeKind.GO, self.stop.stop_number)
            if left > 1:
                self._go_again[client_key] = left - 1

    def _part_changed(self, event: PartEvent) -> None:
        identity = event.identity
        if event.to_state.is_over:
            self.stop.fall_silent(identity)
        if not self.stop.holds:
            return
        if event.to_state is PartState.ACTIVE:
            if event.from_state is not PartState.LATE:
                self.stop.begin_anew(identity, event.part, asyncio.get_running_loop().time())
        elif event.to_state is PartState.LEFT and event.trouble:
            self.stop.lose_slot(identity)  # a bridge whose device is out of reach says goodbye, too
        elif event.to_state is PartState.LEFT:
            self.stop.part_left(identity)
        elif event.to_state in (PartState.STANDBY, PartState.REFUSED):
            if event.client_key == self._asking:
                self.stop.part_left(identity)  # it has begun anew, and drives nothing
            else:
                self.stop.lose_slot(identity)

    def _remember(self, client_key: int, asker: bytes, answer: pnp_messages.Reply | None) -> None:
        if self._askers.get(client_key) != asker:
            if len(self._askers) >= MOST_ASKERS:
                self._forget(next(iter(self._askers)))
            self._askers[client_key] = asker
            self._leases.pop(client_key, None)
            self._helped.pop(client_key, None)
        if isinstance(answer, pnp_messages.VerdictMessage):
            before = self._leases.get(client_key)
            self._leases[client_key] = answer.lease
            member = self._inventory.member(client_key)
            if self.stop.holds and before != answer.lease and member is not None:
                self.stop.begin_anew(*member, asyncio.get_running_loop().time())  # the part has restarted

    def _forget(self, client_key: int) -> None:
        self._askers.pop(client_key, None)
        self._leases.pop(client_key, None)
        self._helped.pop(client_key, None)
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
            self._tell(client_key, pnp_messages.BeatReply(configuration_version=0))
        elif standing.lease == self._leases.get(client_key):
            self._tell(client_key, pnp_messages.BeatReply(configuration_version=standing.configuration_version))
        else:
            self._leases[client_key] = standing.lease
            verdict = Verdict(standing.lease, standing.configuration_version)
            self._tell(client_key, verdict_message(verdict, self._inventory.timing.beat_ms))

    def _partner_changed(self, client_key: int, topic: str, is_there: bool) -> None:
        configuration = self._inventory.configuration_of(client_key)
        if configuration is None:
            return
        kind = pnp_messages.NoticeKind.PARTNER_BACK if is_there else pnp_messages.NoticeKind.PARTNER_LOST
        for place, binding in enumerate(configuration.bindings):
            if binding.topic == topic and not binding.publishes:
                self._notify(client_key, kind, configuration.version, place)

    def _tell_all(self, kind: pnp_messages.NoticeKind) -> None:
        elsewhere = self._elsewhere
        if elsewhere is not None:
            in_any_case(elsewhere.tell_stop)  # one message for all parts of an agent
        here = [key for key in self._askers if elsewhere is None or not elsewhere.has(key)]
        simulated = deque(filter(self._inventory.is_simulated, here))
        notice = _notice(kind, self.stop.stop_number)
        self._to_tell = notice, simulated
        later = frozenset(simulated)
        for client_key in here:
            if client_key not in later:
                in_any_case(self._tell, client_key, notice)
        self._tell_some(notice, simulated)
        if simulated:
            self._tell_rest_after(LATEST_S)

    def stop_was_stored(self) -> None:
        """STOP or GO is stored, and whoever said it is answered in a moment: the other simulated parts come then."""
        if self._rest is not None:
            self._tell_rest_after(ANSWERED_S)

    def _tell_rest_after(self, seconds: float) -> None:
        if self._rest is not None:
            self._rest.cancel()
        self._rest = asyncio.get_running_loop().call_later(seconds, self._tell_rest, *self._to_tell)

    def _tell_rest(self, notice: pnp_messages.Notice, keys: deque[int]) -> None:
        """Tell simulated parts, a few in each turn of the loop, unless all are told something newer by now.

        In a class there are many, and all answer at once: what real parts do, and the answer to whoever has said STOP,
        do not wait for them.
        """
        self._rest = None
        if keys is not self._to_tell[1]:
            return
        self._tell_some(notice, keys)
        if keys:
            asyncio.get_running_loop().call_soon(self._tell_rest, notice, keys)

    def _tell_some(self, notice: pnp_messages.Notice, keys: deque[int]) -> None:
        for _ in range(min(TOLD_IN_TURN, len(keys))):
            in_any_case(self._tell, keys.popleft(), notice)

    def _notify(
        self, client_key: int, kind: pnp_messages.NoticeKind, number: int = 0, binding: int = pnp_messages.NO_BINDING
    ) -> bool:
        return self._tell(client_key, _notice(kind, number, binding))

    def _tell(self, client_key: int, message: pnp_messages.Reply) -> bool:
        asker = self._askers.get(client_key)
        if asker is None:
            return False
        octets = self.requests.encode(message, client_key)
        if octets is None:
            return False
        self.told_unasked += 1
        return self._say(client_key, asker + _NOBODYS_REQUEST, octets)

    def _say(self, client_key: int, identity: bytes, answer: bytes, *, in_compat: bool = False) -> bool:
        if self._elsewhere is not None and self._elsewhere.answer(
            client_key, in_compat=in_compat, identity=identity, body=answer
        ):
            return True
        replier: Entity = self._compat if in_compat else self._compact
        stream_id = STREAM_BEST_EFFORT if len(answer) <= LONGEST_BEST_EFFORT else STREAM_RELIABLE
        try:
            self._client.reply(replier, identity, answer, stream_id=stream_id)
        except (LinkFull, LocalProtocolError) as error:
            # The part asks again by itself.
            self.requests.dropped.count(f"answer: {error}")
            return False
        return True


def _why_said(number: int | None) -> str:
    """Why a part says STOP, in words."""
    if not number:
        return said("it was said at this part, or on its bus")
    return said("this part obeys STOP {number}, of which this master knows nothing", number=number)
