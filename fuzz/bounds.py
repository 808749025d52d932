"""What bounds the memory of an agent, read from its insides: every queue, table and buffer has a limit."""

from __future__ import annotations

from fuzz.case import Violation
from msbot_agent.agent import Agent, AgentSettings
from msbot_agent.agent.flushing import MOST_STALE
from msbot_agent.agent.proxy import Proxy
from msbot_xrce import AgentSession, ClientSession
from msbot_xrce.streams.sending_and_resending import ReliableOutput

REASONS = 80
"""Different reasons that a table of drops may have; more means that a reason has something of the input in it."""


def hold(what: str, value: int, limit: int) -> None:
    """Make sure of a limit.

    Raises:
        Violation: it does not hold.
    """
    if value > limit:
        raise Violation(f"{what}: {value}, and the limit is {limit}")


def check_agent(agent: Agent, settings: AgentSettings) -> None:
    """Every limit of the settings holds.

    Raises:
        Violation: one does not.
    """
    proxies = list(agent._clients)
    hold("clients", len(proxies), settings.max_clients)
    hold("objects in all", sum(len(proxy._tree) for proxy in proxies), settings.max_objects_in_all)
    used = sum(len(proxy._tree) for proxy in proxies)
    if agent._surroundings.budget._free != settings.max_objects_in_all - used:
        raise Violation(f"{used} objects are there, and the budget has {agent._surroundings.budget._free} left")
    for proxy in proxies:
        _check_proxy(proxy, settings)
    _check_shared(agent, proxies)
    hold("topics counted", len(agent.topics()), settings.max_topics + 1)
    hold("marked clients", len(agent._flusher._marked), settings.max_clients)
    hold("gone", len(agent._clients._gone), settings.max_clients)
    for port in agent._ports:
        hold("members of a port", len(port.members), settings.max_clients)
        hold("blocked of a port", len(port.blocked), settings.max_clients)
        hold("gone of a port", sum(map(len, port.gone.values())), settings.max_clients)
        hold("addresses of a port", len(port.gone) + len(port.clients), settings.max_clients)
        hold("reasons of a port", len(port.dropped), REASONS)
        if not port.blocked.keys() <= port.members.keys():
            raise Violation("a client is blocked on a port where it is not")
    for timers in (agent._flusher._timers, agent._flusher._lives):
        hold("owners of timers", len(timers._due), settings.max_clients)
        hold("entries of timers", len(timers), MOST_STALE + 2 * len(timers._due))
        if not timers._due.keys() <= set(proxies):
            raise Violation("a timer keeps a client alive that has gone")
    _check_space(agent, proxies)


def _check_shared(agent: Agent, proxies: list[Proxy]) -> None:
    sessions = [proxy.session for proxy in proxies]
    held = sum(session._memory.used for session in sessions)
    if agent._held.used != held:
        raise Violation(f"{held} octets are held in all, counted {agent._held.used}")
    hold("octets held in all", held, agent._held.limit)
    streams = [stream for session in sessions for stream in session._sender.reliables.values()]
    unacked = sum(len(packet) for stream in streams for packet in stream._unacked.values())
    unacked += sum(len(body) for stream in streams for body in stream._waiting if len(body) > stream._capacity)
    if agent._unacked.used != unacked:
        raise Violation(f"{unacked} octets are not acknowledged, counted {agent._unacked.used}")


def _check_proxy(proxy: Proxy, settings: AgentSettings) -> None:
    hold("objects of a client", len(proxy._tree), settings.max_objects)
    hold("endpoints of a client", len(proxy._endpoints), len(proxy._tree))
    hold("reasons of a client", len(proxy.view(0.0).dropped), REASONS)
    hold("timed sides", len(proxy._timed), 4 * settings.max_objects)
    hold("packets before the link", len(proxy.outbox), 4096)
    check_session(proxy.session, statuses=64)
    for endpoint in proxy._endpoints.values():
        if (side := endpoint.incoming) is not None:
            hold("samples on hand", len(side._on_hand), max(settings.max_depth, settings.max_requests) + 1)


def check_session(session: AgentSession | ClientSession, *, statuses: int) -> None:
    """The windows, queues and buffers of a session are within its settings.

    Raises:
        Violation: one is not.
    """
    settings = session._settings
    sender = session._sender
    held = sum(len(packet) for stream in session._reliable.values() for packet in stream._held.values())
    pieces = sum(len(stream.joiner._buffer) for stream in session._reliable.values())
    if held + pieces != session._memory.used:
        raise Violation(f"{held} octets held and {pieces} in pieces, counted {session._memory.used}")
    hold("octets held", session._memory.used, settings.max_message)
    for name, streams in (
        ("inputs", session._best_effort),
        ("reliable inputs", session._reliable),
        ("outputs", sender.best_efforts),
        ("reliable outputs", sender.reliables),
    ):
        hold(name, len(streams), settings.max_streams)
    for output in sender.reliables.values():
        _check_output(output, settings.window, statuses)
    lanes = settings.max_streams + 1
    hold("packets in a session", len(sender.outbox), lanes * settings.queue_limit + 2 * settings.window * lanes)
    hold("answers", len(sender._answers.packets), settings.queue_limit)
    hold("reasons of a session", len(session.dropped), REASONS)
    hold("events", len(session.events), 0)


def _check_output(output: ReliableOutput, window: int, statuses: int) -> None:
    hold("unacknowledged", len(output._unacked), window)
    hold("waiting", len(output._waiting), statuses + window)
    hold("missed", len(output.missed), window)
    hold("sent again", len(output._resent_at), window)


def _check_space(agent: Agent, proxies: list[Proxy]) -> None:
    endpoints = sum(len(proxy._endpoints) for proxy in proxies)
    desks = agent._surroundings.replies._desks
    hold("askers", sum(len(desk.askers) for desk in desks.values()), endpoints)
    hold("desks", len(desks), endpoints)
