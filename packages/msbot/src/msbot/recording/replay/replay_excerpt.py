"""The piece of a recording that is to be replayed: which slots it has, and what their parts published."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import field
from pathlib import Path
from typing import Final

from msbot.part.join.pnp_messages import TEXT_OCTETS
from msbot.recording.recorder.batch import OWN_TOPICS
from msbot.recording.recorder.recording_file import ENCAPSULATION
from msbot.recording.recordings.mcap_reader import OWN, RecordedMessage, RecordingReader
from msbot.recording.recordings.summary import named_topics
from msbot_agent.text.similar_names import instead_of
from msbot_agent.text.untrusted_input import read_json
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

NS: Final = 1_000_000_000
MOST_OCTETS: Final = 256 << 20
"""Octets of the samples that are held in memory: a replay reads before it begins, so that no disk can make it late."""
SAMPLE_COST: Final = 200
"""Octets that a sample takes besides its content."""


@dataclass(frozen=True, slots=True)
class RecordedSlot:
    """A slot as the recording knows it."""

    name: str
    part_number: str
    local_name: str
    """What its part was called; the slot's name if that was only the part number, or is not known."""


@dataclass(frozen=True, slots=True)
class RecordedSample:
    """What a part published."""

    at_ns: int
    slot: str
    port: str
    type_name: str
    octets: bytes
    """CDR without its encapsulation header, as it travels in DDS-XRCE."""


@dataclass(frozen=True, slots=True)
class ReplayExcerpt:
    """What is replayed."""

    slots: tuple[RecordedSlot, ...]
    samples: tuple[RecordedSample, ...]
    """In the order of their times; at least one."""
    begin_ns: int
    """When the replay begins: the time that was asked for, else the first sample's."""
    damage: str
    """Why the file could not be read to its end, in words; empty: it could."""
    left_out: Counter[str] = field(default_factory=Counter)
    """Messages of these slots, by topic, that no part can publish: the recording does not tell their port, or they are
    no CDR of DDS-XRCE's kind."""

    @property
    def seconds(self) -> float:
        """How long it is."""
        return (self.samples[-1].at_ns - self.begin_ns) / NS


def read_excerpt(
    path: Path,
    wanted: Sequence[str] = (),
    *,
    from_s: float | None = None,
    to_s: float | None = None,
    most_octets: int = MOST_OCTETS,
) -> ReplayExcerpt:
    """Read a piece of a recording.

    Args:
        path: the file.
        wanted: the names of the slots; may be empty if the recording has one only.
        from_s: from this second of the recording on, as `msbot log show` counts them.
        to_s: until this one.
        most_octets: how much may be held in memory.

    Raises:
        ConfigError: the file is no recording, knows nothing of slots, or not of this one; or the piece is empty or too
            large.
    """
    if from_s is not None and to_s is not None and to_s < from_s:
        raise ConfigError(f"nothing lies from {from_s:g} s to {to_s:g} s: --to must not be before --from")
    reader = RecordingReader(path)
    known, began_ns = _survey(reader)
    slots = _chosen(f"{path}, which is damaged ({reader.damage})," if reader.damage else str(path), known, wanted)
    from_ns = None if from_s is None else began_ns + round(from_s * NS)
    to_ns = None if to_s is None else began_ns + round(to_s * NS)
    left_out: Counter[str] = Counter()
    found = _samples(path, slots, from_ns, to_ns, left_out)
    samples = sorted(_bounded(found, most_octets), key=lambda one: one.at_ns)
    if not samples:
        names = ", ".join(slot.name for slot in slots)
        when = "" if from_s is None and to_s is None else f" {_span(from_s, to_s)}"
        raise ConfigError(
            f"{path}: the part in slot {names} published nothing{when} that can be published again"
            + (f": left out is {named_topics(left_out)}" if left_out else ", so there is nothing to replay")
        )
    begin_ns = samples[0].at_ns if from_ns is None else max(from_ns, began_ns)
    return ReplayExcerpt(slots, tuple(samples), begin_ns, reader.damage, left_out)


def _survey(reader: RecordingReader) -> tuple[dict[str, RecordedSlot], int]:
    """The slots of a recording, each as it was known last, and when the recording began."""
    numbers: dict[str, str] = {}
    local_names: dict[str, str] = {}
    began_ns = 0
    for place, message in enumerate(reader.messages()):
        began_ns = began_ns if place else message.logged_ns
        if message.topic == f"{OWN}slots":
            slot, number, local_name = _texts(message, "slot", "part_number", "local_name")
            if slot and number:
                numbers[slot] = number
            if slot and local_name:
                local_names[slot] = local_name
    return {
        slot: RecordedSlot(slot, number, local_names.get(slot) or slot) for slot, number in numbers.items()
    }, began_ns


def _texts(message: RecordedMessage, *names: str) -> tuple[str, ...]:
    """Some fields of a JSON message; one that is not there, or makes no sense as a name, is empty."""
    try:
        fields = read_json(message.data)
    except ValueError:
        fields = None
    found = [fields.get(name) if isinstance(fields, dict) else None for name in names]
    return tuple(
        one if isinstance(one, str) and one.isprintable() and len(one.encode()) <= TEXT_OCTETS else "" for one in found
    )


def _chosen(file: str, known: dict[str, RecordedSlot], wanted: Sequence[str]) -> tuple[RecordedSlot, ...]:
    if not known:
        raise ConfigError(
            f"{file} does not say what is in which slot (topic {OWN}slots): only what MsBOT's flight recorder has "
            "recorded can be replayed, and only what parts said that were active"
        )
    there = ", ".join(known)
    if not wanted:
        if len(known) > 1:
            raise ConfigError(f"{file} has the slots {there}: say which one to replay with --slot")
        return tuple(known.values())
    for name in wanted:
        if name not in known:
            raise ConfigError(f"{file} has no slot {name!r}; {instead_of(name, known)}")
    return tuple(known[name] for name in dict.fromkeys(wanted))


def _samples(
    path: Path, slots: Sequence[RecordedSlot], from_ns: int | None, to_ns: int | None, left_out: Counter[str]
) -> Iterator[RecordedSample]:
    names = {slot.name for slot in slots}
    for message in RecordingReader(path).messages():
        metadata = message.channel.metadata
        port = metadata.get("port", "")
        # What was only repeated at the beginning of a file happened before it.
        if message.slot not in names or message.is_repeated or message.topic.startswith(OWN_TOPICS):
            continue
        if (from_ns is not None and message.at_ns < from_ns) or (to_ns is not None and message.at_ns > to_ns):
            continue
        if not port or message.channel.message_encoding != "cdr" or not message.data.startswith(ENCAPSULATION):
            left_out[message.topic] += 1
        else:
            octets = message.data[len(ENCAPSULATION) :]
            yield RecordedSample(message.at_ns, message.slot, port, metadata.get("type", ""), octets)


def _bounded(samples: Iterator[RecordedSample], most_octets: int) -> Iterator[RecordedSample]:
    held = 0
    for sample in samples:
        held += len(sample.octets) + SAMPLE_COST
        if held > most_octets:
            raise ConfigError(
                f"the piece takes more than {most_octets / 1e6:.0f} MB: choose a shorter one with --from and --to, "
                "or fewer slots"
            )
        yield sample


def _span(from_s: float | None, to_s: float | None) -> str:
    words = [] if from_s is None else [f"from {from_s:g} s on"]
    return " ".join([*words, *([] if to_s is None else [f"until {to_s:g} s"])])
