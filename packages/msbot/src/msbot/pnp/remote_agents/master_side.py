"""The master's side of the agents that it feeds: their clients are parts of the robot like any other. Pure.

Each session at such an agent gets a key of its own here, by which access and inventory know it as they know the
sessions of the master's own agent. What an agent says counts for its own sessions only; which topics of the robot it
may use follows from what its sessions may. An agent that is silent for `SILENT_S` takes its parts with it: they are
lost, for that reason, and come in anew when it is back. What the agent of a pupil brings is that pupil's: it is held
with the pupil, and gets no slot of another group.
"""

from __future__ import annotations

import math
from dataclasses import field
from random import Random
from typing import Final, Protocol

from msbot.pnp.inventory import Inventory
from msbot.pnp.model import Configuration, SlotBinding
from msbot.pnp.profile import Profile
from msbot.pnp.remote_agents.agent_messages import (
    VERSION,
    AgentBeat,
    AgentHello,
    AgentRefused,
    AgentWelcome,
    Answer,
    Ask,
    Close,
    Forgotten,
    FromAgent,
    FromMaster,
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
    short,
)
from msbot.pnp.remote_agents.remote_gate import SILENT_S
from msbot.pnp.robot_gate import RobotGate
from msbot_agent.text.sentence import said
from msbot_xrce.counting import Tally
from msbot_xrce.lazy import dataclass

MAX_AGENTS: Final = 64
MAX_AGENTS_OF_PUPIL: Final = 2
MAX_AGENTS_OF_PUPILS: Final = 32
"""Of all pupils: they leave room for those of the robot."""
MAX_SESSIONS_OF_AGENT: Final = 1024
FORGOTTEN_AFTER_S: Final = 60.0
"""A silent agent is forgotten after this long."""
LONGEST_NAME: Final = 40

SEALED: Final = (
    "this robot seals its samples (authentication key+data), and a seal ends at the part: "
    "carry its parts here with `msbot relay`"
)


class MasterHooks(Protocol):
    """What the agents need of the master around them."""

    def send(self, agent: int, message: FromMaster) -> None:
        """Say it to the agent with that key; what cannot be said now is lost."""

    def ask(self, key: int, in_compat: bool, identity: bytes, body: bytes) -> None:
        """A part asks the inventory."""

    def recheck(self, agent: int) -> None:
        """That agent may use other topics than before."""

    def stop_said(self, agent: str, words: str) -> None:
        """Somebody has said STOP on a link of that agent."""

    def stop_number(self) -> tuple[int, bool]:
        """The latest STOP, and whether it holds."""

    def say(self, words: str) -> None:
        """Tell people."""


@dataclass(frozen=True, slots=True)
class _Client:
    """A client of such an agent, as access wants to know it."""

    key: int
    client_key: int
    link: str
    peer: int
    address: str
    patience_s: float = 0.0
    """Nobody here can probe it: a contest about its identity is decided by its beats alone."""


@dataclass(slots=True, eq=False)
class _Session:
    client: _Client
    times: int
    reads_profile: bool = False
    heard_at: float | None = None


@dataclass(slots=True, eq=False)
class _Agent:
    key: int
    boot: int
    name: str
    heard_at: float
    owner: str = ""
    """The pupil who runs it; empty: no pupil does."""
    is_silent: bool = False
    sessions: dict[int, _Session] = field(default_factory=dict)
    """By the agent's number."""
    stops_taken: int = 0
    topics: frozenset[tuple[str, bool]] = frozenset()
    """What its clients may write (True) and read (False)."""
    said_again: int = 0
    """The session whose rights were repeated last."""

    @property
    def title(self) -> str:
        """What people call it."""
        return said("{name} of {pupil}", name=self.name, pupil=self.owner) if self.owner else self.name


class MasterSide:
    """The agents that one master feeds.

    Args:
        access: hears of sessions as it does from the master's own agent.
        inventory: knows what their parts may do.
        profile: which robot this is.
        around: the master.
        random: draws the keys of sessions.
        sealed: samples are sealed, so no agent can be taken.
    """

    def __init__(
        self,
        access: RobotGate,
        inventory: Inventory,
        profile: Profile,
        around: MasterHooks,
        *,
        random: Random,
        sealed: bool = False,
    ) -> None:
        self.dropped = Tally()
        """Messages without effect, by reason in words."""
        self._access = access
        self._inventory = inventory
        self._profile = profile
        self._around = around
        self._random = random
        self._sealed = sealed
        self._agents: dict[int, _Agent] = {}
        """By the key under which the master's own agent knows the agent's session."""
        self._places: dict[int, tuple[_Agent, int]] = {}
        """Key of a session here -> its agent, and the number that it has there."""
        inventory.on_rights(self.rights_changed)

    # What others ask

    def knows(self, agent: int) -> bool:
        """Whether the client with that key is an agent that was taken."""
        return agent in self._agents

    def may(self, agent: int, topic: str, *, publishes: bool) -> bool:
        """Whether an agent may write or read a topic: one of its clients may."""
        known = self._agents.get(agent)
        return known is not None and (topic, publishes) in known.topics

    def agent_of(self, key: int) -> int | None:
        """The key of the agent that brings the session with that key; None: it is at none of the agents."""
        place = self._places.get(key)
        return None if place is None else place[0].key

    def has(self, key: int) -> bool:
        """Whether the session with that key is at one of the agents."""
        return key in self._places

    def heard_at(self, key: int) -> float | None:
        """When a client was last heard, as its agent has said; None: unknown."""
        place = self._places.get(key)
        return None if place is None else place[0].sessions[place[1]].heard_at

    def probe(self, key: int) -> None:
        """Ask the agent of a client for a sign of life."""
        if (place := self._places.get(key)) is not None:
            self._around.send(place[0].key, Sought(number=place[1]))

    def close(self, key: int, reason: str) -> None:
        """Have the agent end a session."""
        if (place := self._places.get(key)) is not None:
            self._around.send(place[0].key, Close(number=place[1], reason=short(reason)))

    def answer(self, key: int, *, in_compat: bool, identity: bytes, body: bytes) -> bool:
        """Say something to a part; False: it is at none of the agents."""
        place = self._places.get(key)
        if place is None:
            return False
        answer = Answer(number=place[1], compat=int(in_compat), identity=identity, body=body)
        self._around.send(place[0].key, answer)
        return True

    def tell_stop(self) -> None:
        """STOP or GO was said: each agent tells its parts by itself, and every beat repeats it."""
        for agent in self._agents.values():
            self._say_heard(agent, 0)

    def names(self) -> list[tuple[str, int, bool]]:
        """Name, number of sessions and silence of every agent."""
        return [(agent.title, len(agent.sessions), agent.is_silent) for agent in self._agents.values()]

    # What is reported

    def agent_left(self, agent: int) -> None:
        """The session of an agent with the master's own agent has ended."""
        known = self._agents.pop(agent, None)
        if known is not None:
            self._around.say(f"the agent {known.title} has ended")
            self._lose_parts(known, said("gone: the agent {name} has ended", name=known.title))

    def rights_changed(self, key: int) -> None:
        """The topics of a session may have changed."""
        place = self._places.get(key)
        if place is not None:
            self._say_rights(*place)

    def timer(self) -> float:
        """When `handle_timer` wants to be called next."""
        return min(
            (agent.heard_at + (FORGOTTEN_AFTER_S if agent.is_silent else SILENT_S) for agent in self._agents.values()),
            default=math.inf,
        )

    def handle_timer(self, now: float) -> None:
        """Notice agents that are silent, forget those that have been so for long."""
        for agent in list(self._agents.values()):
            if not agent.is_silent and now - agent.heard_at >= SILENT_S:
                agent.is_silent = True
                self._around.say(f"the agent {agent.title} is silent")
                self._lose_parts(agent, said("gone: the agent {name} is silent", name=agent.title))
            elif agent.is_silent and now - agent.heard_at >= FORGOTTEN_AFTER_S:
                del self._agents[agent.key]

    def receive(self, agent: int, message: FromAgent, now: float) -> None:
        """A message of the agent whose session has that key."""
        known = self._agents.get(agent)
        if isinstance(message, AgentHello):
            self._greet(agent, message, now)
        elif known is None or known.is_silent:
            self._around.send(agent, WhoIsThat())
        else:
            known.heard_at = now
            self._take(known, message, now)

    def _take(
        self, agent: _Agent, message: SessionOpen | SessionOver | Ask | AgentBeat | Sign | Remark, now: float
    ) -> None:
        match message:
            case SessionOpen():
                self._session_open(agent, message, now)
            case SessionOver(number=number, reason=reason):
                self._session_over(agent, number, reason)
            case AgentBeat(count=count, stops_said=said_there, words=words):
                if said_there > agent.stops_taken:
                    agent.stops_taken = said_there
                    self._around.stop_said(agent.title, words)
                self._say_heard(agent, count)
                self._say_again(agent)
            case Ask() | Sign() | Remark():
                session = agent.sessions.get(message.number)
                if session is None:
                    self.dropped.count("message about an unknown session of an agent")
                elif isinstance(message, Ask):
                    self._around.ask(session.client.key, bool(message.compat), message.identity, message.body)
                elif isinstance(message, Sign):
                    session.heard_at = now - message.silent_ms / 1000
                else:
                    self._inventory.note(session.client.key, message.words, now)

    # Agents

    def _greet(self, key: int, hello: AgentHello, now: float) -> None:
        known = self._agents.get(key)
        if known is not None and known.boot == hello.boot and not known.is_silent:
            known.heard_at = now
        else:
            # The same one, heard again: a STOP that was taken from it is not another one because it does not know.
            same = (one for one in self._agents.values() if (one.boot, one.name) == (hello.boot, hello.name))
            taken = max((one.stops_taken for one in same), default=0)
            refusal = self._refusal(key, hello)
            if refusal:
                self._around.send(key, AgentRefused(reason=refusal))
                return
            if known is not None:
                self._lose_parts(known, said("gone: the agent {name} was started again", name=known.title))
            agent = _Agent(key, hello.boot, hello.name, now, self._owner_of(key), stops_taken=taken)
            self._agents[key] = agent
            self._inventory.is_no_part(key)
            self._around.say(f"the agent {agent.title} brings parts")
        profile = self._profile
        self._around.send(
            key,
            AgentWelcome(
                boot=hello.boot,
                robot=profile.name,
                version=profile.version,
                serial_number=profile.serial_number,
                released=profile.released,
                manufacturer=profile.manufacturer,
            ),
        )

    def _refusal(self, key: int, hello: AgentHello) -> str:
        """Why the agent is not taken; empty when it is. A silent one of the same name makes room."""
        if self._sealed:
            return SEALED
        if hello.version != VERSION:
            return f"it speaks version {hello.version} of this protocol, the master speaks version {VERSION}"
        if not hello.name.isprintable() or not 0 < len(hello.name) <= LONGEST_NAME:
            return f"its name has to be printable, and of at most {LONGEST_NAME} characters"
        whose = self._owner_of(key)
        for other in list(self._agents.values()):
            if (other.name, other.owner) == (hello.name, whose) and other.key != key:
                if not other.is_silent:
                    return f"an agent with the name {hello.name} is there already: give this one another with --name"
                del self._agents[other.key]
        others = [other for other in self._agents.values() if other.key != key]
        if whose and sum(other.owner == whose for other in others) >= MAX_AGENTS_OF_PUPIL:
            return f"{MAX_AGENTS_OF_PUPIL} agents of {whose} are there already"
        if whose and sum(bool(other.owner) for other in others) >= MAX_AGENTS_OF_PUPILS:
            return f"{MAX_AGENTS_OF_PUPILS} agents of pupils are there already"
        if key not in self._agents and len(self._agents) >= MAX_AGENTS:
            return f"{MAX_AGENTS} agents are there already"
        return ""

    def _owner_of(self, key: int) -> str:
        return self._inventory.pupil_parts.pupil_of(key)

    def _configuration(self, key: int) -> Configuration | None:
        """What a session may use now: nothing while its pupil is held."""
        return None if self._inventory.pupil_parts.is_held(key) else self._inventory.configuration_of(key)

    def _say_heard(self, agent: _Agent, count: int) -> None:
        number, holds = self._around.stop_number()
        self._around.send(
            agent.key, MasterHeard(count=count, stop=number, holds=int(holds), stops_confirmed=agent.stops_taken)
        )

    # Sessions

    def _session_open(self, agent: _Agent, message: SessionOpen, now: float) -> None:
        session = agent.sessions.get(message.number)
        if session is None:
            if len(agent.sessions) >= MAX_SESSIONS_OF_AGENT:
                self.dropped.count("session of an agent beyond its share")
                return
            client = self._client_of(agent, message)
            session = agent.sessions[message.number] = _Session(client, message.times)
            self._places[client.key] = agent, message.number
            self._access.joined(client)
        elif message.times > session.times:
            session.times, session.reads_profile = message.times, False
            session.client = self._client_of(agent, message, key=session.client.key)
            self._access.joined(session.client)
        if message.reads_profile and message.times == session.times and not session.reads_profile:
            session.reads_profile = True
            self._inventory.profile_asked(session.client.key, now)
        self._say_rights(agent, message.number)

    def _client_of(self, agent: _Agent, message: SessionOpen, *, key: int = 0) -> _Client:
        if not key:
            key = self._random.getrandbits(32) or 1
            while self._inventory.shown_key(key) is not None:
                key = self._random.getrandbits(32) or 1
        address = said("{address} by agent {name}", address=message.address, name=agent.title)
        return _Client(key, message.client_key or key, f"agent {agent.title}", message.number, address)

    def _session_over(self, agent: _Agent, number: int, reason: str) -> None:
        session = agent.sessions.pop(number, None)
        if session is not None:
            del self._places[session.client.key]
            self._access.session_ended(session.client, reason)
            self._topics_changed(agent)
        self._around.send(agent.key, Forgotten(number=number))

    def _lose_parts(self, agent: _Agent, reason: str) -> None:
        sessions, agent.sessions = agent.sessions, {}
        for session in sessions.values():
            del self._places[session.client.key]
        for session in sessions.values():
            self._access.session_ended(session.client, reason)
        self._topics_changed(agent)

    def _say_rights(self, agent: _Agent, number: int) -> None:
        session = agent.sessions[number]
        configuration = self._inventory.configuration_of(session.client.key)
        self._topics_changed(agent)
        if why := self._inventory.pupil_parts.why_held(session.client.key):
            self._around.send(agent.key, Held(number=number, why=short(why)))
        self._around.send(
            agent.key,
            Rights(
                number=number,
                times=session.times,
                reads_profile=int(session.reads_profile),
                settled=int(configuration is not None),
                topics=_topics_of(self._configuration(session.client.key)),
            ),
        )

    def _say_again(self, agent: _Agent) -> None:
        """The rights of one session in turn, because nobody confirms a change of them, and it may have been lost."""
        numbers = sorted(agent.sessions)
        if numbers:
            later = [number for number in numbers if number > agent.said_again]
            agent.said_again = (later or numbers)[0]
            self._say_rights(agent, agent.said_again)

    def _topics_changed(self, agent: _Agent) -> None:
        configurations = [self._configuration(one.client.key) for one in agent.sessions.values()]
        bindings = (binding for one in configurations if one is not None for binding in one.bindings)
        topics = frozenset(topic for binding in bindings for topic in binding.opened())
        if topics != agent.topics:
            agent.topics = topics
            self._around.recheck(agent.key)


def _topics_of(configuration: Configuration | None) -> list[OpenTopic]:
    bindings: tuple[SlotBinding, ...] = () if configuration is None else configuration.bindings
    found = {(one.topic, one.publishes): one for one in bindings if one.topic}
    return [
        OpenTopic(topic=topic, topic_type=one.type_name, publishes=int(publishes), reliable=int(one.reliable))
        for (topic, publishes), one in found.items()
    ]
