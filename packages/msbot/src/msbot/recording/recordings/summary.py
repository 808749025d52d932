"""Recordings as lines for people, as tables, and as frames of a bus."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from math import isfinite
from struct import error as StructError
from struct import pack, unpack

from msbot.pnp import came_in_32_bits, value_words
from msbot.recording.recorder.batch import BLUEPRINT, MEASURED, OWN_TOPICS, SHOWN, SLOTS
from msbot.recording.recorder.schemas import FRAME
from msbot.recording.recordings.mcap_reader import FRAMES, OWN, Decoder, RecordedMessage
from msbot_agent.link.can.protocol import Frame
from msbot_agent.text.sentence import printable
from msbot_xrce.counting import amount

MOST_NAMED = 20
"""Topics that a sentence names."""
Row = tuple[str, str, str, str]
"""`(topic, slot, field, value)`."""


def line_of(message: RecordedMessage, decoder: Decoder) -> str | None:
    """A message in words; None for frames, which `frame_of` reads."""
    topic = message.topic
    if frame_of(message) is not None:
        return None
    fields = decoder.fields(message)
    if fields is None:
        return f"{_who(message)}{amount(len(message.data), 'byte')}, whose meaning the recording does not tell"
    if topic == f"{OWN}events" and isinstance(fields.get("words"), str):
        return str(fields["words"])
    if topic == f"{OWN}acts":
        given = ", ".join(f"{name}={value}" for name, value in _object(fields.get("arguments")).items())
        return f"{fields.get('who')}: {fields.get('operation')}({given}): {fields.get('words')}"
    if topic == f"{OWN}faults":
        end = "begins" if fields.get("begins") else f"is over ({fields.get('reason')})"
        return f"fault {fields.get('number')} of {fields.get('who')} {end}: {fields.get('words')}"
    if topic == f"{OWN}stop":
        return _stop_words(fields)
    if topic == BLUEPRINT:
        return f"the robot has {_counted(fields, 'slots', 'slot')} and {_counted(fields, 'wires', 'wire')}"
    if topic == SHOWN:
        return (
            f"{_counted(fields, 'by_hand', 'port')} driven by hand, {_counted(fields, 'faults', 'place')} with faults"
        )
    if topic == SLOTS:
        return _slot_words(fields)
    if topic == MEASURED:
        return _measured_words(fields)
    return f"{_who(message)}{', '.join(f'{name} {value_words(value)}' for name, value in fields.items())}"


def named_topics(counts: Counter[str]) -> str:
    """Topics with their number of messages: `/scan (12), /odd (3) and 4 other topics`."""
    named = [f"{printable(topic)} ({count})" for topic, count in counts.most_common(MOST_NAMED)]
    more = f" and {amount(len(counts) - MOST_NAMED, 'other topic')}" if len(counts) > MOST_NAMED else ""
    return f"{', '.join(named)}{more}"


def unread_words(counts: Counter[str]) -> str:
    """Says which topics were left out because nobody can read them; empty: none."""
    if not counts:
        return ""
    return f"left out, since the recording does not tell what the samples mean: {named_topics(counts)}"


def rows_of(message: RecordedMessage, decoder: Decoder) -> Iterator[Row]:
    """A sample as rows of a table, one for each field; nothing for what is no sample."""
    if message.topic.startswith(OWN_TOPICS):
        return
    for name, value in flat_fields(decoder.fields(message) or {}):
        yield message.topic, message.slot, name, _whole(value)


def frame_of(message: RecordedMessage) -> Frame | None:
    """The CAN frame that was recorded; None: it is something else."""
    if not message.topic.startswith(FRAMES):
        return None
    try:
        can_id, extended, fd, brs, esi, remote, error, _, dlc, size = FRAME.unpack_from(message.data, 4)
    except StructError:
        return None
    data = message.data[4 + FRAME.size : 4 + FRAME.size + size]
    if size != len(data):
        return None
    return Frame(
        can_id,
        data,
        bool(extended),
        bool(fd),
        bool(brs),
        bool(remote),
        bool(error),
        bool(esi),
        remote_length=dlc if remote else 0,
        long_dlc=0 if remote else dlc,
    )


def _stop_words(fields: Mapping[str, object]) -> str:
    if not fields.get("stopped"):
        return "no STOP"
    confirmed = _count(fields, "confirmed")
    return f"STOP by {fields.get('by')}" + (f", confirmed by {confirmed}" if confirmed else "")


def _slot_words(fields: Mapping[str, object]) -> str:
    """`knob: POT-10K (simulated), level -> fan_power, period_s = 0.1`."""
    nature = f" ({fields['nature']})" if fields.get("nature") else ""
    ports = fields.get("ports")
    ties = [
        f"{port.get('port')} {'->' if port.get('publishes') else '<-'} {port.get('topic')}"
        for port in (ports if isinstance(ports, list) else ())
        if isinstance(port, dict)
    ]
    settings = [f"{name} = {value}" for name, value in _object(fields.get("settings")).items()]
    return f"{fields.get('slot')}: " + ", ".join([f"{fields.get('part_number')}{nature}", *ties, *settings])


def _measured_words(fields: Mapping[str, object]) -> str:
    """`late 14.8 ms, latency 0.103 ms, beats after: AA 0.9996 s`; what was not measured is left out."""
    words = [
        f"{name} {_short(fields[key])} ms"
        for name, key in (("late", "late_ms"), ("latency", "latency_ms"))
        if fields.get(key) is not None
    ]
    of_slots = (("beats after", "beats", " s"), ("acknowledged after", "acks_ms", " ms"), ("life", "lives", ""))
    for name, key, unit in of_slots:
        if values := _object(fields.get(key)):
            words.append(f"{name}: " + ", ".join(f"{slot} {_short(value)}{unit}" for slot, value in values.items()))
    return ", ".join(words)


def _count(fields: Mapping[str, object], name: str) -> int:
    found = fields.get(name)
    return len(found) if isinstance(found, list | dict) else 0


def _counted(fields: Mapping[str, object], name: str, one: str) -> str:
    return amount(_count(fields, name), one)


def _who(message: RecordedMessage) -> str:
    return f"{message.slot}: " if message.slot else ""


def _object(value: object) -> Mapping[str, object]:
    return value if isinstance(value, dict) else {}


def _short(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.7g}"
    return str(value)


def _whole(value: object) -> str:
    """A value from which a program gets the same one again."""
    if not isinstance(value, float):
        return value.hex() if isinstance(value, bytes) else str(value)
    if not isfinite(value) or not came_in_32_bits(value):
        return repr(value)
    words = (f"{value:.{digits}g}" for digits in (7, 8))
    return next((one for one in words if unpack("<f", pack("<f", float(one)))[0] == value), f"{value:.9g}")


def flat_fields(fields: Mapping[str, object]) -> list[tuple[str, object]]:
    """The fields of a message with the way to each: `pose.x`, `samples[0]`."""
    return list(_flat("", fields))


def _flat(way: str, value: object) -> Iterator[tuple[str, object]]:
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _flat(f"{way}.{name}" if way else name, inner)
    elif isinstance(value, list):
        for place, inner in enumerate(value):
            yield from _flat(f"{way}[{place}]", inner)
    else:
        yield way, value
