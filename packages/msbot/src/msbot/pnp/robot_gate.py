"""Who may use which topic: the agent's gate, decided by the inventory (thesis 3.10.3, R45, R48, R52, R57).

===========================  ============================================================================
who                          may
===========================  ============================================================================
anybody                      open a session; read the profile; ask the inventory and get the answers to it alone
an agent that brings parts   also: write and read what its own parts may
a registered part            also: write and read the topics of its slot's bindings, by direction; of a service
                             write requests, or read them and write replies
a pupil's part that is held  what anybody may: a teacher has frozen the class, or taken it over
the robot's own services     everything; they are the clients of the in-process link, and nobody else is
===========================  ============================================================================

Topics that the blueprint declares free are open to all but held parts. Everything else is neither accepted nor
delivered.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import partial
from typing import Protocol

from msbot.part.calls import ReplyStatus, encode_reply
from msbot.part.join import thesis_messages
from msbot.part.join.seal import Seal
from msbot.pnp.inventory import Inventory
from msbot.pnp.profile import PROFILE_TOPIC
from msbot_agent.link import pupil_of_connection
from msbot_agent.text.sentence import said
from msbot_xrce.counting import Tally

INVENTORY_SERVICE = "msbot_inventory"
INVENTORY_REQUEST_TOPIC = "msbot_inventory_Request"
INVENTORY_REPLY_TOPIC = "msbot_inventory_Reply"
AGENTS_REQUEST_TOPIC = "msbot_agents_Request"
AGENTS_REPLY_TOPIC = "msbot_agents_Reply"
"""Agents that this master feeds (`remote_agents`)."""

TRUSTED_LINK = "inproc"
"""Name of the link that the robot's own services use."""

GOODBYE = "session deleted"
"""The agent's words for a session that its client ended; any other reason means that the client vanished."""
REPLACED = "replaced"
"""Start of the agent's words for a session that its own client reopens; `joined` follows at once."""

RESERVED_TOPICS = frozenset(
    {
        PROFILE_TOPIC,
        INVENTORY_REQUEST_TOPIC,
        INVENTORY_REPLY_TOPIC,
        thesis_messages.REQUEST_TOPIC,
        thesis_messages.REPLY_TOPIC,
        AGENTS_REQUEST_TOPIC,
        AGENTS_REPLY_TOPIC,
    }
)
"""No binding and no free topic opens these topics any further than steps 1 and 2 need."""
_ASKING = frozenset({INVENTORY_REQUEST_TOPIC, thesis_messages.REQUEST_TOPIC, AGENTS_REQUEST_TOPIC})
"""Topics by which anybody asks the robot's services."""

_MAX_PLUGS = 1024
FLOOD_TOLD_S = 60.0
"""Shortest time between two reports that the same part floods the robot."""


class AskingClient(Protocol):
    """What access needs to know about a client that asks for something; `msbot_agent.agent.ClientInfo` provides it."""

    @property
    def key(self) -> int:
        """The key by which the agent knows the session."""

    @property
    def client_key(self) -> int:
        """The client key that the session shows; another session may show the same one."""

    @property
    def patience_s(self) -> float:
        """How long another client on its link may take to answer a probe."""

    @property
    def link(self) -> str:
        """Name of the link that it uses."""

    @property
    def peer(self) -> Hashable:
        """The peer, as the link knows it."""

    @property
    def address(self) -> str:
        """The peer in words."""


class RemoteAgents(Protocol):
    """What access needs to know about the agents that the master feeds; `remote_agents.MasterSide` provides it."""

    def knows(self, agent: int) -> bool:
        """Whether the client with that key is such an agent."""

    def may(self, agent: int, topic: str, *, publishes: bool) -> bool:
        """Whether it may write or read a topic: one of its clients may."""

    def agent_of(self, key: int) -> int | None:
        """The key of the agent that brings the session with that key; None: it is at the master's own agent."""


class _SampleSealer:
    """Opens and seals the samples of one session for the agent; fits `msbot_agent.agent.SampleGuard`."""

    def __init__(self, seal: Seal, refused: Callable[[str], None]) -> None:
        self.seal = seal.seal
        self._seal = seal
        self._refused = refused

    def covers(self, topic: str) -> bool:
        """The services of parts; what parts ask the robot's own services has a seal of its own."""
        return topic not in RESERVED_TOPICS

    def open(self, object_id: int, sample: bytes) -> bytes | None:
        opened = self._seal.open(object_id, sample)
        if opened is None and self._seal.is_confirmed:  # before, the part may not have heard of its new seal
            self._refused(self._seal.reason)
        return opened


class RobotGate:
    """Implements `msbot_agent.agent.Gate` for one robot.

    Args:
        inventory: knows who is registered.
        clock: returns the present time in seconds; the inventory's clock.
        free_topics: topics that everybody may write and read.
        trusted_link: name of the link of the robot's own services.
    """

    def __init__(
        self,
        inventory: Inventory,
        *,
        clock: Callable[[], float],
        free_topics: frozenset[str] = frozenset(),
        trusted_link: str = TRUSTED_LINK,
    ) -> None:
        self.denied = Tally()
        """Sessions that were refused, by reason in words."""
        self._inventory = inventory
        self._clock = clock
        self._trusted_link = trusted_link
        self._free = free_topics - RESERVED_TOPICS
        self._agents: RemoteAgents | None = None
        self._on_left: Callable[[int], object] = lambda _: None
        self._links: dict[int, str] = {}
        """Client key -> the link its session is open on."""
        self._flood_told_at: dict[int, float] = {}
        """Client key -> when its flooding was last reported."""
        self._plugs: dict[tuple[str, Hashable], float] = {}
        """Peers that a link has seen arrive and that have no session yet -> when."""

    def use_agents(self, agents: RemoteAgents, on_left: Callable[[int], object]) -> None:
        """Clients may be agents that bring parts; `on_left` is called with the key of every session that has ended."""
        self._agents, self._on_left = agents, on_left

    def may_join(self, client: AskingClient) -> bool:
        """Whether the client may open a session: not with a key that is in use on another link."""
        if self._is_trusted(client) or self._links.get(client.key, client.link) == client.link:
            return True
        self.denied.count("client key in use on another link")
        return False

    def keeps(self, client: AskingClient) -> bool:  # noqa: ARG002 - the gate's signature
        """Always true: knowing a part's client key must not be enough to throw it out."""
        return True

    def is_settled(self, client: AskingClient) -> bool:
        """Whether the client is the robot's own, an agent that brings parts, or holds a slot: strangers cannot displace
        it."""
        if self._is_trusted(client) or (self._agents is not None and self._agents.knows(client.key)):
            return True
        return self._inventory.configuration_of(client.key) is not None

    def guard_of(self, client: AskingClient) -> _SampleSealer | None:
        """Opens and seals the samples of a part that has proved its key, in a robot with sealed samples; else None."""
        seal = self._inventory.seals.of(client.key)
        return None if seal is None else _SampleSealer(seal, partial(self._sample_refused, client.key))

    def reply_if_unserved(self, client: AskingClient, topic: str) -> Callable[[int | None], bytes | None] | None:
        """What a part that calls learns at once when the robot does not pass its request on."""
        if self._is_trusted(client) or topic in RESERVED_TOPICS:
            return None
        return partial(self._reply_for_nobody, client.key, topic)

    def limits(self, client: AskingClient, packets_per_s: float, share: float) -> bool:
        """Limit every part, and journal it at most once a minute; never limit the robot's own services."""
        if self._is_trusted(client):
            return False
        now = self._clock()
        if now - self._flood_told_at.get(client.key, -FLOOD_TOLD_S) >= FLOOD_TOLD_S:
            self._flood_told_at[client.key] = now
            words = said(
                "sends {packets} packets a second, more than its share of {share}: the rest is not read",
                packets=round(packets_per_s),
                share=round(share),
            )
            self._inventory.note(client.key, words, now)
        return True

    def limits_strangers(self) -> bool:
        """Always: anybody can send packets to a robot."""
        return True

    def is_latched(self, topic: str) -> bool:
        """Whether readers get the topic's last sample without asking for it; the thesis' parts do not ask."""
        return topic == PROFILE_TOPIC

    def joined(self, client: AskingClient) -> None:
        """A session was opened, or opened again: the client's rights are void until it has registered."""
        self._links[client.key] = client.link
        plugged_in_at = self._plugs.pop((client.link, client.peer), None)
        pupil = self._pupil_behind(client)
        is_agent = self._agents is not None and self._agents.knows(client.key)
        if is_agent and pupil != self._inventory.pupil_parts.pupil_of(client.key):
            self._on_left(client.key)  # it brought parts as somebody else: they come in anew
        self._inventory.client_joined(
            client.key,
            client.address,
            self._clock(),
            quiet=self._is_trusted(client),
            plugged_in_at=plugged_in_at,
            client_key=client.client_key,
            patience_s=client.patience_s,
            pupil=pupil,
        )

    def session_ended(self, client: AskingClient, reason: str) -> None:
        """The session has ended; if its own client is reopening it, the part keeps its slot."""
        if reason.startswith(REPLACED):
            return
        self._links.pop(client.key, None)
        self._flood_told_at.pop(client.key, None)
        self._inventory.client_left(client.key, reason, self._clock(), politely=reason == GOODBYE)
        self._on_left(client.key)

    def may_write(self, client: AskingClient, topic: str) -> bool:
        """Whether samples of this client may enter the topic."""
        if self._is_trusted(client) or topic in _ASKING:
            return True
        return self._may_use(client.key, topic, publishes=True)

    def may_read(self, client: AskingClient, topic: str) -> bool:
        """Whether samples of the topic may go to this client; asking for the profile begins step 1."""
        if self._is_trusted(client):
            return True
        if topic == PROFILE_TOPIC:
            self._inventory.profile_asked(client.key, self._clock())
            return True
        return self._may_use(client.key, topic, publishes=False)

    def peer_joined(self, link: str, peer: Hashable, now: float) -> None:
        """A link has seen a peer arrive: the time until it is `active` is measured from here."""
        if len(self._plugs) >= _MAX_PLUGS:
            del self._plugs[next(iter(self._plugs))]
        self._plugs[link, peer] = now

    def _pupil_behind(self, client: AskingClient) -> str:
        """The pupil whose rights a client has: what a pupil's agent brings is that pupil's."""
        agent = None if self._agents is None else self._agents.agent_of(client.key)
        return pupil_of_connection(client.peer) if agent is None else self._inventory.pupil_parts.pupil_of(agent)

    def _is_trusted(self, client: AskingClient) -> bool:
        return client.link == self._trusted_link

    def _may_use(self, key: int, topic: str, *, publishes: bool) -> bool:
        if self._inventory.pupil_parts.is_held(key):
            return False
        return topic in self._free or self._is_bound(key, topic, publishes=publishes)

    def _is_bound(self, key: int, topic: str, *, publishes: bool) -> bool:
        if topic in RESERVED_TOPICS:
            return False
        if self._agents is not None and self._agents.knows(key):
            return self._agents.may(key, topic, publishes=publishes)
        configuration = self._inventory.configuration_of(key)
        if configuration is None:
            return False
        return any(binding.opens(topic, publishes=publishes) for binding in configuration.bindings)

    def _reply_for_nobody(self, key: int, topic: str, readers: int | None) -> bytes | None:
        is_agent = self._agents is not None and self._agents.knows(key)
        why = self._inventory.why_not_passed(None if is_agent else key, topic, readers)
        return encode_reply(ReplyStatus.NOT_PASSED, why) if why else None

    def _sample_refused(self, key: int, reason: str) -> None:
        self._inventory.sample_refused(key, reason, self._clock())
