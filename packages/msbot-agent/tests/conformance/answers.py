"""Reads the hand-made dialogues with the genuine agent: `-> octets sent`, `<- octets received`, in titled sections."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from tests import ROOT

VECTORS = ROOT / "tests" / "vectors"

_SENT = re.compile(r"^\s+-> ((?:[0-9a-f]{2} ?)*)$")
_CAME = re.compile(r"^\s+<- ((?:[0-9a-f]{2} )+)\(\d+\)$")
_SET_UP = "   setup status 81 80 00 00"


@dataclass(slots=True)
class Step:
    """One thing that was done, and what the genuine agent answered to it."""

    sent: bytes | None
    """None: the entities of `AgentRig.set_up` were created."""
    came: list[bytes] = field(default_factory=list)
    from_before: bool = False
    """Sent from the port of the section before, not from that of this section."""


@dataclass(slots=True)
class Section:
    """What stands below one title."""

    title: str
    steps: list[Step] = field(default_factory=list)

    @property
    def is_new(self) -> bool:
        """Whether it comes from a port of its own: it begins without a session."""
        first = self.steps[0].sent
        return ("unknown" in self.title and "client" in self.title) or not first or first[0] in (0x00, 0x80)


def sections(name: str) -> Iterator[Section]:
    """The sections of a file."""
    section = Section("")
    from_before = False
    for line in (VECTORS / name).read_text().splitlines():
        sent, came = _SENT.match(line), _CAME.match(line)
        if line.startswith("###"):
            if section.steps:
                yield section
            section = Section(line[3:].strip())
            from_before = False
        elif line.startswith("  old endpoint"):
            from_before = True
        elif sent:
            section.steps.append(Step(bytes.fromhex(sent[1]), from_before=from_before))
        elif line.startswith(_SET_UP):
            section.steps.append(Step(None))
        elif came and section.steps:
            section.steps[-1].came.append(bytes.fromhex(came[1]))
    yield section
