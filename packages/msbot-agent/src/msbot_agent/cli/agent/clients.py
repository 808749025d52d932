"""`msbot clients`: the sessions of every agent and master that runs on this computer."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable, Iterator
from itertools import groupby

import click

from msbot_agent.agent import AgentStatus, ClientView, StreamView, read_statuses
from msbot_agent.cli.table import for_terminal, print_table
from msbot_agent.log import TerminalHandler
from msbot_agent.text.sentence import printable
from msbot_xrce.counting import amount


@click.command("clients")
@click.option("--json", "as_json", is_flag=True, help="Print a JSON list of agents instead of tables.")
def command(*, as_json: bool) -> None:
    """List the clients of every agent and master that you run on this computer.

    For each: its key and session, where it is, its objects, its streams, what it sent and received, and what was
    dropped.
    """

    logging.basicConfig(level=logging.WARNING, handlers=[TerminalHandler("%(message)s")])
    statuses = read_statuses()
    if as_json:
        click.echo(json.dumps([as_dict(status) for status in statuses]))
    elif not statuses:
        click.echo("No agent or master of yours is running on this computer.")
    else:
        show(statuses)


# Agents and their clients as tables, and as JSON.


def show(statuses: Iterable[AgentStatus]) -> None:
    """Print a table for each agent."""
    for status in statuses:
        click.echo(headline(status))
        if status.clients:
            print_table(TITLES, [_row(view) for view in status.clients])
        for line in (*(line for view in status.clients for line in _more(view)), *footlines(status)):
            click.echo(for_terminal(printable(line)))


def headline(status: AgentStatus) -> str:
    """`agent on udp:127.0.0.1:8888, process 4711, up 3 min: 2 clients`."""
    where = " on " if status.what == "agent" else " of "
    count = len(status.clients)
    clients = amount(count, "client") if count else "no clients"
    return f"{status.what}{where}{status.name}, process {status.pid}, up {duration(status.up_s)}: {clients}"


def footlines(status: AgentStatus) -> list[str]:
    """What is wrong with a master's database, and what was dropped outside of any session."""
    trouble = status.details.get("trouble")
    lines = [f"The robot goes on from memory: {trouble}"] if trouble else []
    if status.dropped:
        lines.append(f"packets of nobody: {counts(status.dropped)}")
    for view in status.clients:
        lines += [f"{view.key:08X}: {trouble}" for item in view.objects for trouble in item.troubles]
    lines += [f"{link.name}: {counts(link.dropped)}" for link in status.links if link.dropped]
    return lines


def duration(seconds: float) -> str:
    """A time in words for people: `0.2 s`, `12 s`, `3 min`, `2 h`, `5 d`."""
    if seconds < 10:
        return f"{seconds:.1f} s"
    for unit, size in (("d", 86_400), ("h", 3_600), ("min", 60)):
        if seconds >= 2 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s"


def counts(numbers: dict[str, int]) -> str:
    """`3 x reason, 1 x other reason`."""
    return ", ".join(f"{count} x {reason}" for reason, count in numbers.items())


def objects_words(view: ClientView) -> str:
    """How many objects, and the topics among them; those that the gate rejects in brackets."""
    topics: dict[str, bool] = {}
    for item in view.objects:
        if item.topic is not None:
            topics[item.topic] = topics.get(item.topic, True) and item.attached
    names = ", ".join(name if attached else f"({name})" for name, attached in topics.items())
    return f"{len(view.objects)}: {names}" if names else str(len(view.objects))


def streams_words(streams: Iterable[StreamView]) -> str:
    """`80 in 12 out 34 (2 on their way)`: the newest number in each direction of each stream."""
    words = []
    for stream_id, both in groupby(sorted(streams, key=lambda one: (one.stream_id, one.outgoing)), key=_stream_id):
        word = f"{stream_id:02X}"
        for stream in both:
            word += f" {'out' if stream.outgoing else 'in'} {'-' if stream.last is None else stream.last}"
            if stream.unacked:
                word += f" ({stream.unacked} on their way)"
            if stream.waiting:
                word += f" ({stream.waiting} wait)"
        words.append(word)
    return ", ".join(words)


def dropped_words(view: ClientView) -> str:
    """Everything that was not done for the client, and why."""
    refused = {f"not allowed on {topic}": count for topic, count in view.refused.items()}
    return counts({**view.dropped, **refused})


def as_dict(status: AgentStatus) -> dict[str, object]:
    """One agent for JSON; keys, session and object ids as hexadecimal text."""
    return {
        "what": status.what,
        "name": status.name,
        "pid": status.pid,
        "up_s": round(status.up_s, 3),
        "links": [
            {
                "name": link.name,
                "packets_in": link.packets_in,
                "packets_out": link.packets_out,
                "bytes_in": link.bytes_in,
                "bytes_out": link.bytes_out,
                "dropped": link.dropped,
            }
            for link in status.links
        ],
        "topics": [
            {"name": name, "published": published, "delivered": delivered}
            for name, published, delivered in status.topics
        ],
        "dropped": status.dropped,
        "clients": [_client_dict(view) for view in status.clients],
    }


def _client_dict(view: ClientView) -> dict[str, object]:
    return {
        "key": f"{view.key:08X}",
        "session": f"{view.session_id:02X}",
        "link": view.link,
        "address": view.address,
        "gone": view.gone,
        "mtu": view.mtu,
        "age_s": round(view.age_s, 3),
        "silent_s": round(view.silent_s, 3),
        "objects": [
            {
                "id": f"{item.object_id:04X}",
                "kind": item.kind,
                "topic": item.topic,
                "attached": item.attached,
                "troubles": list(item.troubles),
            }
            for item in view.objects
        ],
        "streams": [
            {
                "id": f"{stream.stream_id:02X}",
                "direction": "out" if stream.outgoing else "in",
                "last": stream.last,
                "unacked": stream.unacked,
                "waiting": stream.waiting,
            }
            for stream in view.streams
        ],
        "packets_in": view.packets_in,
        "packets_out": view.packets_out,
        "bytes_in": view.bytes_in,
        "bytes_out": view.bytes_out,
        "published": view.published,
        "delivered": view.delivered,
        "waiting": view.waiting,
        "resent": view.resent,
        "repeated": view.repeated,
        "dropped": view.dropped,
        "refused": view.refused,
    }


def _stream_id(stream: StreamView) -> int:
    return stream.stream_id


TITLES = (
    *("client", "session", "link", "address", "age", "heard"),
    *("published", "delivered", "in", "out", "resent"),
)
"""Of the table; `in` and `out` are packets."""


def _row(view: ClientView) -> tuple[str, ...]:
    heard = f"{duration(view.silent_s)} ago" if view.gone is None else view.gone
    numbers = (view.published, view.delivered, view.packets_in, view.packets_out, view.resent)
    return (
        f"{view.key:08X}",
        f"{view.session_id:02X}",
        view.link,
        view.address,
        duration(view.age_s),
        heard,
        *map(str, numbers),
    )


def _more(view: ClientView) -> Iterator[str]:
    """What has no room in the table."""
    about = {
        "objects": objects_words(view),
        "streams": streams_words(view.streams),
        "dropped": dropped_words(view),
    }
    return (f"{view.key:08X}  {name}: {words}" for name, words in about.items() if words)
