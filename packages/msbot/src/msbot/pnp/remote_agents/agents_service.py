"""Carries what the master and the agents that it feeds say to each other: a service like the inventory's.

An agent has two requesters, so that the answers to the one come on its reliable stream and those to the other on its
best-effort stream: STOP and beats wait for nothing that was lost before them. The master answers by the one that fits
the message.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections import deque
from collections.abc import Callable
from functools import partial
from random import Random
from typing import Final

from msbot.part import Client, ClientMaker, ServiceNames
from msbot.pnp.emergency_stop import EmergencyStop
from msbot.pnp.inventory import Inventory
from msbot.pnp.inventory_service import LONGEST_BEST_EFFORT, InventoryService
from msbot.pnp.profile import Profile
from msbot.pnp.remote_agents.agent_messages import (
    REPLY_TYPE,
    REQUEST_TYPE,
    SERVICE,
    AgentBeat,
    AgentHello,
    AgentRefused,
    AgentWelcome,
    Answer,
    Ask,
    FromAgent,
    FromMaster,
    MasterHeard,
    Sign,
    Sought,
    WhoIsThat,
    decode_from_agent,
    is_sendable,
)
from msbot.pnp.remote_agents.master_side import MasterSide
from msbot.pnp.robot_gate import RobotGate
from msbot_agent.agent import client_key_of
from msbot_xrce.errors import LinkFull, LocalProtocolError, RemoteProtocolError
from msbot_xrce.messages import STREAM_BEST_EFFORT

NAMES: Final = ServiceNames(SERVICE, REQUEST_TYPE, REPLY_TYPE)

MOST_WAITING: Final = 4096
"""Messages that wait for the reliable stream; beyond, the oldest is dropped, and said again later."""

_GUID_BYTES: Final = 16
_NOBODYS_REQUEST: Final = bytes(8)
_AT_ONCE: Final = (AgentHello, AgentBeat, Sign, AgentWelcome, AgentRefused, MasterHeard, WhoIsThat, Sought)
_LONGEST_BEAT: Final = 6
"""Requests of parts up to this length are beats: one that comes late is worth nothing."""


def goes_at_once(message: FromAgent | FromMaster) -> bool:
    """Whether a message goes on the best-effort stream: it is repeated, or worth nothing later."""
    if isinstance(message, Answer):
        return len(message.body) <= LONGEST_BEST_EFFORT
    if isinstance(message, Ask):
        return len(message.body) <= _LONGEST_BEAT
    return isinstance(message, _AT_ONCE)


class ReliableSendQueue:
    """What waits for room on the reliable stream of a client."""

    def __init__(self, write: Callable[[bytes], object]) -> None:
        self._write = write
        self._waiting: deque[bytes] = deque(maxlen=MOST_WAITING)

    def send(self, octets: bytes) -> None:
        """Send, in order, now or when there is room."""
        self._waiting.append(octets)
        self.go_on()

    def go_on(self) -> None:
        """There may be room again."""
        try:
            while self._waiting:
                self._write(self._waiting[0])
                self._waiting.popleft()
        except LinkFull:
            return
        except LocalProtocolError:
            self._waiting.clear()  # no session: everything is said anew in the next one


class RemoteAgentsService:
    """Feeds the gates of agents elsewhere, and speaks for their parts to the inventory.

    Args:
        make_client: makes the client that speaks for it, called with the callbacks that it needs.
        access: hears of sessions.
        inventory: knows what their parts may do.
        services: answers their parts.
        profile: which robot this is.
        stop: STOP of this robot.
        random: draws the keys of sessions.
        sealed: samples are sealed, so no agent can be taken.
        on_stop: called with the agent's name and the reason when somebody has said STOP on a link there.
        on_topics: called with the key of an agent that may use other topics than before.
        say: tells people.
    """

    def __init__(
        self,
        make_client: ClientMaker,
        *,
        access: RobotGate,
        inventory: Inventory,
        services: InventoryService,
        profile: Profile,
        stop: EmergencyStop,
        random: Random,
        sealed: bool,
        on_stop: Callable[[str, str], object],
        on_topics: Callable[[int], object],
        say: Callable[[str], object],
    ) -> None:
        self.end = MasterSide(access, inventory, profile, self, random=random, sealed=sealed)
        self._client: Client = make_client(on_request=self._request_received, on_room=self._go_on)
        participant = self._client.create_participant(SERVICE)
        self._replier = self._client.create_replier(participant, NAMES)
        self._client.read(self._replier)
        self._services = services
        self._emergency_stop = stop
        self._on_stop = on_stop
        self._on_topics = on_topics
        self._say = say
        self._at_once: dict[int, bytes] = {}
        """Key of an agent -> GUID of the requester whose answers come on its best-effort stream."""
        self._in_order: dict[int, bytes] = {}
        """The same for its reliable stream."""
        self._sayings = ReliableSendQueue(partial(self._client.write, self._replier))
        self._awake_at = 0.0
        self._sooner = asyncio.Event()

    async def run(self) -> None:
        """Serve until cancelled.

        Raises:
            LinkDown: the link to the master's own agent cannot be opened.
        """
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._client.run())
            tasks.create_task(self._keep_time())

    async def _keep_time(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            self._sooner.clear()
            self._awake_at = self.end.timer()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout_at(None if self._awake_at == math.inf else self._awake_at):
                    await self._sooner.wait()
            self.end.handle_timer(loop.time())

    def _go_on(self) -> None:
        self._sayings.go_on()

    def agent_left(self, agent: int) -> None:
        """A session with the master's own agent has ended; it may be that of an agent."""
        self._at_once.pop(agent, None)
        self._in_order.pop(agent, None)
        self.end.agent_left(agent)

    def _request_received(self, object_id: int, request_id: int, identity: bytes, body: bytes) -> None:  # noqa: ARG002
        guid = identity[:_GUID_BYTES]
        agent = client_key_of(guid)
        try:
            message = decode_from_agent(body)
        except RemoteProtocolError:
            self.end.dropped.count("message of an agent that cannot be read")
            return
        (self._at_once if goes_at_once(message) else self._in_order)[agent] = guid
        self.end.receive(agent, message, asyncio.get_running_loop().time())
        if self.end.timer() < self._awake_at:
            self._sooner.set()

    # What the agents need of the master (`master_side.MasterHooks`).

    def send(self, agent: int, message: FromMaster) -> None:
        """Say it to the agent with that key; what cannot be said now is lost."""
        ways = self._at_once if goes_at_once(message) else self._in_order
        guid = ways.get(agent) or self._at_once.get(agent) or self._in_order.get(agent)
        octets = is_sendable(message)
        if guid is None or octets is None:
            self.end.dropped.count("message to an agent that cannot be said")
            return
        reply = guid + _NOBODYS_REQUEST + octets
        if ways is self._in_order or len(octets) > LONGEST_BEST_EFFORT:
            self._sayings.send(reply)
            return
        try:
            self._client.write(self._replier, reply, stream_id=STREAM_BEST_EFFORT)
        except (LinkFull, LocalProtocolError) as error:
            self.end.dropped.count(f"message to an agent: {error}")

    def ask(self, key: int, in_compat: bool, identity: bytes, body: bytes) -> None:
        """A part asks the inventory."""
        self._services.request_from_elsewhere(key, in_compat=in_compat, identity=identity, body=body)

    def recheck(self, agent: int) -> None:
        """That agent may use other topics than before."""
        self._on_topics(agent)

    def stop_said(self, agent: str, words: str) -> None:
        """Somebody has said STOP on a link of that agent."""
        self._on_stop(agent, words)

    def stop_number(self) -> tuple[int, bool]:
        """The latest STOP, and whether it holds."""
        return self._emergency_stop.stop_number, self._emergency_stop.holds

    def say(self, words: str) -> None:
        """Tell people."""
        self._say(words)
