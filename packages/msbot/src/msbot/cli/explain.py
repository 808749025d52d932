"""`msbot explain`: a message, a frame or a capture, from its meaning down to its bits."""

from __future__ import annotations

import json
import re
from collections.abc import Hashable, Iterable
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

import click

from msbot.cli.bus.frame_words import library_of, listener_for
from msbot.cli.robot_options import library_option
from msbot.pnp import SessionListener
from msbot_agent.cli.group import complain
from msbot_agent.cli.options import WholeRange, json_option
from msbot_agent.explain.relay_layout import RELAY
from msbot_agent.explain.relay_words import RelayWords, relay_words
from msbot_agent.link.can.protocol import Frame, frame_bits, parse_frame, wire_bits
from msbot_agent.text.untrusted_input import open_input_file
from msbot_xrce import FoundField, dissector, read_fields
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    from msbot_agent.explain.datagrams import CapturedFrame, Datagram

AGENT_PORT = 8888
RATES = (125_000, 250_000, 500_000, 1_000_000)
RECORDING = b"\x89MCAP0"
_HEX = re.compile(r"(?:[0-9a-fA-F]{2}[\s:.-]?){4,}")


@click.command("explain")
@click.argument("what", nargs=-1, metavar="WHAT...")
@click.option(
    "--port",
    "agent_port",
    type=WholeRange(1, 65535),
    default=AGENT_PORT,
    show_default=True,
    help="UDP port of the agent, in captures of a network.",
)
@click.option("--fields", is_flag=True, help="In captures: also every field of every message.")
@click.option("--blueprint", type=click.Path(path_type=Path), help="The robot's blueprint, for the names of its types.")
@library_option
@click.option(
    "--wireshark",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Write a dissector for Wireshark (Lua) to this file.",
)
@json_option
def command(
    what: tuple[str, ...],
    *,
    agent_port: int,
    fields: bool,
    blueprint: Path | None,
    folders: tuple[Path, ...],
    wireshark: Path | None,
    as_json: bool,
) -> None:
    """Explain WHAT: bytes of a DDS-XRCE message in hexadecimal, CAN frames as candump writes them (103#C181000A), or
    a file with frames (candump) or packets (pcap, pcapng).

    Shows the meaning, the fields with their bytes, and for a frame its bits and its cost on the wire.
    """
    if wireshark is not None:
        _write(wireshark, dissector((agent_port,), RELAY))
        click.echo(f"{wireshark} is written: tshark -X lua_script:{wireshark} -r CAPTURE, or Wireshark's plugin folder")
        if not what:
            return
    if not what:
        raise click.UsageError("say what: bytes in hexadecimal, a frame such as 103#C181000A, or a file")
    told = _told(what, agent_port, library_of(blueprint, folders, complain), fields=fields)
    if as_json:
        click.echo(json.dumps(list(told), ensure_ascii=False))
        return
    for number, one in enumerate(told):
        for line in _lines(one, after=number > 0):
            click.echo(line)


def _told(what: tuple[str, ...], agent_port: int, library: object, *, fields: bool) -> Iterable[dict[str, object]]:
    """What is said of each message or frame, as plain values."""
    from msbot.config import Library

    known = library if isinstance(library, Library) else None
    if len(what) == 1 and Path(what[0]).is_file():
        yield from _file(Path(what[0]), agent_port, known, fields=fields)
    elif any("#" in word for word in what):
        listener = listener_for(known, legacy=False)
        for word in what:
            frame = parse_frame(word)
            words = listener.explain_frame(frame, 0.0)
            yield {"frame": word, "plain": list(words.plain), "words": list(words.protocol), **_frame_facts(frame)}
    else:
        text = " ".join(what)
        if not _HEX.fullmatch(text):
            raise ConfigError(
                f"{text[:60]!r} is no file here, no frame such as 103#C181000A, and no message in hexadecimal of 4 "
                "bytes or more, such as 81010000 0905..."
            )
        yield _message(bytes.fromhex(re.sub(r"[\s:.-]", "", text)))


def _file(path: Path, agent_port: int, library: object, *, fields: bool) -> Iterable[dict[str, object]]:
    from msbot.config import Library
    from msbot_agent.explain.datagrams import ENDINGS, read_capture

    with open_input_file(path) as stream:
        if stream.read(len(RECORDING)) == RECORDING:
            raise ConfigError(f"{path} is a recording: `msbot log show {path}` says what is in it")
    listener = listener_for(library if isinstance(library, Library) else None, legacy=False)
    if path.suffix.lower() not in ENDINGS:
        from msbot.cli.bus.frame_log import FrameReader

        reader = FrameReader()
        for line in reader.read(str(path)):
            words = listener.explain_frame(line.frame, line.at or 0.0)
            facts = _frame_facts(line.frame) if fields else {}
            yield {
                "at_s": line.at,
                "frame": _notation(line.frame),
                "plain": list(words.plain),
                "words": list(words.protocol),
                **facts,
            }
        reader.tell(str(path), complain)
        return
    overhearer = SessionListener()
    for found in read_capture(path):
        yield _captured(found, listener, overhearer, agent_port, fields=fields)


def _captured(
    found: Datagram | CapturedFrame, listener: object, overhearer: SessionListener, agent_port: int, *, fields: bool
) -> dict[str, object]:
    from msbot.pnp import FrameListener
    from msbot_agent.explain.datagrams import Datagram, other_protocol

    if isinstance(found, Datagram):
        up = found.target_port == agent_port
        peer: Hashable = (found.source, found.source_port) if up else (found.target, found.target_port)
        other = other_protocol(found)
        if not other and (relayed := relay_words(found.octets)) is not None:
            carried = (found.source, found.source_port) if relayed.up else (found.target, found.target_port)
            way = f"{found.source}:{found.source_port} -> {found.target}:{found.target_port}"
            told = _relayed(relayed, overhearer, (*carried, relayed.part), len(found.octets), fields=fields)
            return {"at_s": found.at, "way": way, **told}
        said = None if other else overhearer.explain_packet(found.octets, peer, up=up)
        way = f"{found.source}:{found.source_port} -> {found.target}:{found.target_port}"
        facts = _message_facts(found.octets) if fields and said is not None else {}
        return {
            "at_s": found.at,
            "way": way,
            "octets": len(found.octets),
            "plain": [] if said is None else list(said.plain),
            "words": [other] if said is None else list(said.protocol),
            **facts,
        }
    assert isinstance(listener, FrameListener)
    heard = listener.explain_frame(found.frame, found.at)
    facts = _frame_facts(found.frame) if fields else {}
    return {
        "at_s": found.at,
        "frame": _notation(found.frame),
        "plain": list(heard.plain),
        "words": list(heard.protocol),
        **facts,
    }


def _message(octets: bytes) -> dict[str, object]:
    if (relayed := relay_words(octets)) is not None:
        return _relayed(relayed, SessionListener(), relayed.part, len(octets), fields=True)
    heard = SessionListener().explain_packet(octets, "here", up=True)
    return {"octets": len(octets), "plain": list(heard.plain), "words": list(heard.protocol), **_message_facts(octets)}


def _relayed(
    relayed: RelayWords, overhearer: SessionListener, peer: Hashable, octets: int, *, fields: bool
) -> dict[str, object]:
    """A message of a relay, and the packet of a part in it."""
    if not relayed.packet:
        return {"octets": octets, "plain": [], "words": [relayed.words]}
    heard = overhearer.explain_packet(relayed.packet, peer, up=relayed.up)
    facts = _message_facts(relayed.packet) if fields else {}
    return {"octets": octets, "plain": list(heard.plain), "words": [relayed.words, *heard.protocol], **facts}


def _message_facts(octets: bytes) -> dict[str, object]:
    fields, fault = read_fields(octets)
    return {"fields": [_field(one) for one in fields], "fault": fault}


def _field(one: FoundField) -> dict[str, object]:
    return {"part": one.part, "name": one.name, "at": one.start, "hex": one.octets.hex(), "value": one.words}


def _frame_facts(frame: Frame) -> dict[str, object]:
    bits = wire_bits(frame)
    cost = frame_bits(frame)
    groups = [(name, list(run)) for name, run in groupby(bits, key=lambda bit: bit.field)]
    return {
        "bits": [
            {"field": name, "bits": "".join(f"({bit.level})" if bit.stuff else str(bit.level) for bit in run)}
            for name, run in groups
        ],
        "cost": {
            "nominal_bits": cost.nominal_bits,
            "data_bits": cost.data_bits,
            "stuff_bits": sum(bit.stuff for bit in bits),
            "microseconds": {rate: round(1e6 * cost.seconds(rate), 1) for rate in RATES},
        },
    }


def _lines(one: dict[str, object], *, after: bool) -> Iterable[str]:
    """What is printed of one message or frame."""
    details = "fields" in one or "bits" in one
    if after and details:
        yield ""
    at = one.get("at_s")
    head = f"({at:.6f})  " if isinstance(at, float) else ""
    head += str(one.get("frame") or one.get("way") or "")
    if head:
        yield head
    yield from (f"  {line}" for line in _texts(one, "plain"))
    yield from (f"  {line}" for line in _texts(one, "words"))
    found = one.get("fields")
    if isinstance(found, list) and found:
        yield ""
        yield "  byte   bytes                     field                         value"
        for row in found:
            name = f"{row['part']}.{row['name']}"
            shown = row["hex"] if len(row["hex"]) <= 24 else f"{row['hex'][:20]}..."
            yield f"  {row['at']:5}  {shown:24}  {name:28}  {row['value']}"
        if one.get("fault"):
            yield f"  the rest makes no sense: {one['fault']}"
    runs = one.get("bits")
    if isinstance(runs, list):
        yield ""
        yield "  bits on the wire, 0 dominant, 1 recessive; (stuff bits)"
        yield from (f"  {run['field']:14}  {run['bits']}" for run in runs)
        yield f"  {_cost(one['cost'])}"


def _cost(cost: object) -> str:
    assert isinstance(cost, dict)
    times = ", ".join(f"{time:g} µs at {rate // 1000} kbit/s" for rate, time in cost["microseconds"].items())
    bits = cost["nominal_bits"] + cost["data_bits"]
    return f"{bits} bits with the pause after it, {cost['stuff_bits']} of them stuffed: {times}"


def _texts(one: dict[str, object], key: str) -> list[str]:
    found = one.get(key)
    return [str(line) for line in found] if isinstance(found, list) else []


def _notation(frame: Frame) -> str:
    from msbot_agent.link.can.protocol import format_frame

    return format_frame(frame)


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{path} cannot be written ({error.strerror}): name another file") from None
