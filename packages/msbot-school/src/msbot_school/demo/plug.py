"""One part's place in the demo: what is plugged in there now, and what earlier parts there did."""

from __future__ import annotations

import asyncio
from random import Random

from msbot.config import Library
from msbot.part import Part, SimGpio
from msbot.part.sample_parts import SAMPLE_PARTS, make_sample
from msbot.sim import SimulatedPart, make_simulator

_SAMPLE_NAMES = {sample.part_number: name for name, sample in SAMPLE_PARTS.items()}


class Plug:
    """A place for one part; the thesis' three are their own programs, all others are simulated from the library.

    Args:
        name: what the place is called.
        slot: the slot that the part is meant for.
        part_number: its part number.
        uid: 8 octets; the same however often it is plugged in.
        library: where its part number is looked up.
    """

    def __init__(self, name: str, slot: str, part_number: str, uid: bytes, library: Library | None) -> None:
        self.name = name
        self.slot = slot
        self.part_number = part_number
        self.uid = uid
        self.board = SimGpio()
        """Survives unplugging, as a real board would; its pins keep what the part last set."""
        self.part: Part | None = None
        self.simulated: SimulatedPart | None = None
        """The simulated device, to be played with; None for the thesis' three, and for an empty place."""
        self.task: asyncio.Task[None] | None = None
        self.plugged_at = 0.0
        self.active_at: float | None = None
        self.earlier_in = 0
        self.earlier_out = 0
        self._library = library

    def make(self, random: Random) -> Part:
        """A fresh part for this place."""
        sample = _SAMPLE_NAMES.get(self.part_number)
        if sample is not None:
            own_name = "" if self.name == self.slot else self.name
            self.part = make_sample(sample, uid=self.uid, random=random, board=self.board, local_name=own_name)
        else:
            self.simulated = make_simulator(
                self.part_number, uid=self.uid, local_name=self.name, random=random, library=self._library
            )
            self.part = self.simulated.part
        return self.part

    def clear(self) -> None:
        """Note that the part is unplugged; its counts are kept."""
        self.earlier_in, self.earlier_out = self.messages_in, self.messages_out
        self.part = self.simulated = self.task = None

    @property
    def messages_in(self) -> int:
        """Samples that arrived in the part, over all the times it was plugged in."""
        return self.earlier_in + (self.part.counters.messages_in if self.part is not None else 0)

    @property
    def messages_out(self) -> int:
        """Samples that the part published, over all the times it was plugged in."""
        return self.earlier_out + (self.part.counters.messages_out if self.part is not None else 0)
