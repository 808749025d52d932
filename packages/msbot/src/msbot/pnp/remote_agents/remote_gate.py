"""The gate of an agent that a master elsewhere feeds: it knows the verdicts it was told, and decides nothing. Pure.

Theory of operation. Sessions of clients are told to the master until it has said their rights; requests of parts to the
inventory are passed on, and its answers back. Both sides repeat what was not confirmed with every beat, so nothing
hangs on one message. Without a word from the master for `SILENT_S` the agent is cut off: the verdicts it has stay in
force, so that parts that are in go on speaking to each other, and no client that is not in is let in, until the master
is heard again and says what holds now.

STOP goes both ways and has numbers on both sides: each is repeated with every beat until the other has confirmed it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import field
from functools import partial
from typing import Final, Protocol

from msbot.part.calls import ReplyStatus, encode_reply
from msbot.part.join import pnp_messages, thesis_messages
from msbot.pnp.model import SlotBinding
from msbot.pnp.profile import PROFILE_TOPIC, Profile
from msbot.pnp.remote_agents.agent_messages import (
    AgentBeat,
    AgentHello,
    AgentRefused,
    AgentWelcome,
    Answer,
    Ask,
    Close,
    Forgotten,
    FromAgent,
    Held,
    MasterHeard,
    OpenTopic,
    Remark,
    Rights,
    SessionOpen,
    SessionOver,
    Sign,
    Sought,
    WhoIsThat,
    decode_from_master,
    short,
)
from msbot.pnp.robot_gate import REPLACED, TRUSTED_LINK
from msbot_agent.agent import ClientInfo
from msbot_xrce.counting import Tally, amount
from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.lazy import dataclass

# What the gate of an agent that a master feeds needs of the agent around it.


class AgentHooks(Protocol):
    """What the gate does to the agent around it."""

    def send(self, message: FromAgent) -> None:
        """Say it to the master; what cannot be said now is lost."""

    def rights_changed(self, client_key: int) -> None:
        """The verdict on that client has changed."""

    def topics_changed(self) -> None:
        """Other topics than before are used by clients that are in."""

    def answer(self, in_compat: bool, identity: bytes, body: bytes) -> None:
        """The inventory says something to a part."""

    def order(self, kind: pnp_messages.NoticeKind, number: int) -> None:
        """STOP or GO to all."""

    def welcome(self, profile: Profile) -> None:
        """The master says which robot this is."""

    def session_ended(self, client_key: int) -> None:
        """A client's session has ended."""

    def close(self, client_key: int, reason: str) -> None:
        """End a client's session."""

    def heard_at(self, client_key: int) -> float | None:
        """When a client was last heard."""

    def probe(self, client_key: int) -> None:
        """Ask a client for a sign of life."""

    def say(self, words: str) -> None:
        """Tell people."""


BEAT_S: Final = 0.5
SILENT_S: Final = 2.0
"""Without a word from the master for this long, the agent is cut off."""
REPEATED_PER_BEAT: Final = 32
"""Sessions, and ends of sessions, that are said again with one beat."""
MOST_ENDED: Final = 1024
"""Ends of sessions that the master has not confirmed; beyond, the oldest is not repeated any more."""
REFUSED_AGAIN_S: Final = 5.0
"""A refusal is told again only after another one, or after this time without any."""
FLOOD_TOLD_S: Final = 60.0
"""Shortest time between two remarks that the same client sends too much."""

_ASKABLE = frozenset({pnp_messages.INVENTORY_REQUEST_TOPIC, thesis_messages.REQUEST_TOPIC})


@dataclass(slots=True, eq=False)
class _Session:
    number: int
    info: ClientInfo
    times: int = 1
    reads_profile: bool = False
    confirmed: tuple[int, bool] = (0, False)
    """How often it was opened, and whether it read the profile, as the master has heard."""
    settled: bool = False
    topics: dict[tuple[str, bool], OpenTopic] = field(default_factory=dict)
    """What it may write (True) and read."""
    held: str = ""
    """Why it may use nothing now, as the master has said; empty: it is not held."""
    flood_told_at: float = -math.inf

    @property
    def is_confirmed(self) -> bool:
        return self.confirmed == (self.times, self.reads_profile)

    def as_message(self) -> SessionOpen:
        return SessionOpen(
            number=self.number,
            times=self.times,
            client_key=self.info.client_key,
            reads_profile=int(self.reads_profile),
            address=short(self.info.address),
        )


class RemoteGate:
    """Implements `msbot_agent.agent.Gate` with what a master elsewhere says.

    Args:
        boot: drawn at this start.
        name: what the master calls the agent.
        around: the agent.
        clock: the present time in seconds.
    """

    def __init__(self, *, boot: int, name: str, around: AgentHooks, clock: Callable[[], float]) -> None:
        self.dropped = Tally()
        """What was not passed on, by reason in words."""
        self.is_welcome = False
        """The master has taken the agent, and knows it still as far as the agent has heard."""
        self.is_cut_off = False
        """The master was heard once, and is silent now."""
        self._boot = boot
        self._name = name
        self._around = around
        self._clock = clock
        self._sessions: dict[int, _Session] = {}
        """By the agent's key of the client."""
        self._by_number: dict[int, _Session] = {}
        self._ended: dict[int, str] = {}
        """Number of an ended session that the master still knows -> why."""
        self._numbers = 0
        self._beats = 0
        self._beat_at = math.inf
        self._heard_at = -math.inf
        self._refused: tuple[str, float] = ("", -math.inf)
        self._stop = 0
        """The master's STOP that was passed on and holds; 0 = none."""
        self._stops_said = 0
        self._stops_confirmed = 0
        self._stop_words = ""

    # The gate

    def may_join(self, client: ClientInfo) -> bool:
        """Whether a session may be opened, or opened again: only while the master is heard."""
        if self._is_own(client) or (self.is_welcome and not self.is_cut_off):
            return True
        self.dropped.count("login while no master is heard")
        return False

    def keeps(self, client: ClientInfo) -> bool:  # noqa: ARG002 - the gate's signature
        """Always true: knowing a part's client key must not be enough to throw it out."""
        return True

    def is_settled(self, client: ClientInfo) -> bool:
        """Whether the client holds a slot, as far as the master has said."""
        session = self._sessions.get(client.key)
        return self._is_own(client) or (session is not None and session.settled)

    def limits(self, client: ClientInfo, packets_per_s: float, share: float) -> bool:
        """Limit every part, and tell the master at most once a minute."""
        if self._is_own(client):
            return False
        session, now = self._sessions.get(client.key), self._clock()
        if session is not None and now - session.flood_told_at >= FLOOD_TOLD_S:
            session.flood_told_at = now
            words = (
                f"sends {packets_per_s:.0f} packets a second, more than its share of {share:.0f}: the rest is not read"
            )
            self._around.send(Remark(number=session.number, words=words))
        return True

    def limits_strangers(self) -> bool:
        """Always: anybody can send packets to a robot."""
        return True

    def is_latched(self, topic: str) -> bool:
        """Whether readers get the topic's last sample without asking for it."""
        return topic == PROFILE_TOPIC

    def joined(self, client: ClientInfo) -> None:
        """A session was opened, or opened again: its rights are void until the master has said them."""
        if self._is_own(client):
            return
        session = self._sessions.get(client.key)
        if session is None:
            self._numbers += 1
            session = self._sessions[client.key] = self._by_number[self._numbers] = _Session(self._numbers, client)
        else:
            session.times += 1
            session.info, session.reads_profile = client, False
            self._void(session)
        self._around.send(session.as_message())

    def session_ended(self, client: ClientInfo, reason: str) -> None:
        """The session has ended; if its own client is reopening it, the part keeps its slot."""
        if reason.startswith(REPLACED):
            return
        session = self._sessions.pop(client.key, None)
        if session is None:
            return
        del self._by_number[session.number]
        self._around.session_ended(client.key)
        self._void(session)
        if len(self._ended) >= MOST_ENDED:
            del self._ended[next(iter(self._ended))]
        self._ended[session.number] = short(reason)
        self._around.send(SessionOver(number=session.number, reason=short(reason)))

    def may_write(self, client: ClientInfo, topic: str) -> bool:
        """Whether samples of this client may enter the topic."""
        if self._is_own(client) or topic in _ASKABLE:
            return True
        session = self._sessions.get(client.key)
        return session is not None and (topic, True) in session.topics

    def may_read(self, client: ClientInfo, topic: str) -> bool:
        """Whether samples of the topic may go to this client; asking for the profile begins step 1."""
        if self._is_own(client):
            return True
        session = self._sessions.get(client.key)
        if topic != PROFILE_TOPIC:
            return session is not None and (topic, False) in session.topics
        if session is not None and not session.reads_profile:
            session.reads_profile = True
            self._around.send(session.as_message())
        return True

    def guard_of(self, client: ClientInfo) -> None:
        """Always None: a robot with sealed samples takes no agents."""

    def reply_if_unserved(self, client: ClientInfo, topic: str) -> Callable[[int | None], bytes | None] | None:
        """What a part that is held learns at once; to all others the master says who does not serve."""
        if self._is_own(client) or topic in _ASKABLE:
            return None
        return partial(self._reply_while_held, client.key)

    # What the agent is told by its surroundings

    def start(self, now: float) -> None:
        """Begin to look for the master."""
        self._beat_at = now

    def lost_master(self) -> None:
        """The session with the master is over: another one, perhaps with another master, begins anew."""
        self.is_welcome = False

    def ask(self, client_key: int, *, in_compat: bool, identity: bytes, body: bytes) -> None:
        """A part asks the inventory."""
        session = self._sessions.get(client_key)
        if session is None or not self.is_welcome:
            self.dropped.count("request while no master is heard" if session else "request without a session")
            return
        self._around.send(Ask(number=session.number, compat=int(in_compat), identity=identity, body=body))

    def stop_said(self, words: str) -> None:
        """Somebody has said STOP on one of the agent's links: the master is told until it has confirmed."""
        self._stops_said += 1
        self._stop_words = short(words)
        self._send_beat()

    def topics(self) -> Iterable[OpenTopic]:
        """What the clients that are in may write and read."""
        return (topic for session in self._sessions.values() for topic in session.topics.values())

    def timer(self) -> float:
        """When `handle_timer` wants to be called next."""
        return self._beat_at

    def handle_timer(self, now: float) -> None:
        """Beat, repeat what was not confirmed, notice silence."""
        if now < self._beat_at:
            return
        self._beat_at = now + BEAT_S
        if not self.is_cut_off and self._heard_at > -math.inf and now - self._heard_at > SILENT_S:
            self.is_cut_off = True
            self._around.say(
                f"the master is silent: {self._count()} stay as they are, and nobody new is let in until it is back"
            )
        if not self.is_welcome:
            self._around.send(AgentHello(boot=self._boot, name=self._name))
        self._send_beat()
        if not self.is_welcome or self.is_cut_off:
            return
        unconfirmed = [session for session in self._sessions.values() if not session.is_confirmed]
        for session in unconfirmed[:REPEATED_PER_BEAT]:
            self._around.send(session.as_message())
        for number, reason in list(self._ended.items())[:REPEATED_PER_BEAT]:
            self._around.send(SessionOver(number=number, reason=reason))

    # What the master says

    def receive(self, octets: bytes, now: float) -> None:
        """A message of the master."""
        try:
            message = decode_from_master(octets)
        except RemoteProtocolError:
            self.dropped.count("message of the master that cannot be read")
            return
        if not isinstance(message, AgentRefused):
            self._hear(now)
        match message:
            case AgentWelcome():
                self._welcome(message)
            case AgentRefused():
                self._be_refused(message.reason, now)
            case WhoIsThat():
                self._begin_anew()
            case MasterHeard():
                self._take_stop(message)
            case Rights():
                self._take_rights(message)
            case Held():
                if (session := self._by_number.get(message.number)) is not None:
                    session.held = message.why
            case Forgotten():
                self._ended.pop(message.number, None)
            case Answer():
                if message.number in self._by_number:
                    self._around.answer(bool(message.compat), message.identity, message.body)
            case Sought():
                self._look_for(message.number, now)
            case Close():
                if (session := self._by_number.get(message.number)) is not None:
                    self._around.close(session.info.key, message.reason)

    def _hear(self, now: float) -> None:
        if self.is_cut_off:
            self.is_cut_off = False
            self._around.say(f"the master is heard again after {now - self._heard_at:.1f} s")
        self._heard_at = now

    def _welcome(self, message: AgentWelcome) -> None:
        if message.boot != self._boot or self.is_welcome:
            return
        self.is_welcome = True
        self._around.welcome(
            Profile(message.robot, message.version, message.serial_number, message.released, message.manufacturer)
        )
        for session in self._sessions.values():
            session.confirmed = (0, False)
            self._around.send(session.as_message())

    def _be_refused(self, reason: str, now: float) -> None:
        self.is_welcome = False
        told, at = self._refused
        self._refused = (reason, now)
        if reason != told or now - at > REFUSED_AGAIN_S:
            self._around.say(f"the master does not take this agent: {reason}")

    def _begin_anew(self) -> None:
        """The master knows nothing of this agent: which sessions there are is said again; their verdicts stay so long.

        Sessions that have ended need not be told any more.
        """
        self.is_welcome = False
        self._ended.clear()
        self._around.send(AgentHello(boot=self._boot, name=self._name))

    def _take_stop(self, message: MasterHeard) -> None:
        self._stops_confirmed = max(self._stops_confirmed, min(message.stops_confirmed, self._stops_said))
        if message.holds and message.stop != self._stop:
            self._stop = message.stop
            self._around.order(pnp_messages.NoticeKind.STOP, message.stop)
        elif not message.holds and self._stop:
            number, self._stop = self._stop, 0
            self._around.order(pnp_messages.NoticeKind.GO, max(number, message.stop))

    def _take_rights(self, message: Rights) -> None:
        session = self._by_number.get(message.number)
        if session is None or message.times != session.times:
            return  # it has ended or was opened again in the meantime: what holds for that one is on its way
        session.confirmed = (message.times, bool(message.reads_profile))
        topics = {opened: topic for topic in message.topics for opened in _opened_by(topic)}
        if topics:
            session.held = ""  # also where the verdict between, without topics, was lost
        if (session.settled, session.topics.keys()) == (bool(message.settled), topics.keys()):
            return
        session.settled, session.topics = bool(message.settled), topics
        self._around.topics_changed()
        self._around.rights_changed(session.info.key)

    def _look_for(self, number: int, now: float) -> None:
        session = self._by_number.get(number)
        at = None if session is None else self._around.heard_at(session.info.key)
        if session is None or at is None:
            return
        self._around.send(Sign(number=number, silent_ms=min(0xFFFFFFFF, max(0, round((now - at) * 1000)))))
        self._around.probe(session.info.key)

    # Helpers

    def _send_beat(self) -> None:
        self._beats = self._beats + 1 & 0xFFFFFFFF
        unconfirmed = self._stops_said if self._stops_said > self._stops_confirmed else 0
        words = self._stop_words if unconfirmed else ""
        self._around.send(AgentBeat(count=self._beats, stops_said=unconfirmed, words=words))

    def _reply_while_held(self, client_key: int, _readers: int | None) -> bytes | None:
        session = self._sessions.get(client_key)
        return encode_reply(ReplyStatus.NOT_PASSED, session.held) if session is not None and session.held else None

    def _void(self, session: _Session) -> None:
        session.settled, session.held = False, ""
        if session.topics:
            session.topics = {}
            self._around.topics_changed()

    def _count(self) -> str:
        count = sum(session.settled for session in self._sessions.values())
        return amount(count, "part that is in", "parts that are in")

    @staticmethod
    def _is_own(client: ClientInfo) -> bool:
        return client.link == TRUSTED_LINK


def _opened_by(topic: OpenTopic) -> Iterable[tuple[str, bool]]:
    """The topics of the space that a topic or service opens, each with whether it may be written."""
    return SlotBinding("", topic.topic, topic.topic_type, bool(topic.publishes)).opened()
