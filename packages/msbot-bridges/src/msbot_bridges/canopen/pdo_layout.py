"""What the octets of a PDO mean. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from msbot_bridges.canopen.objects import Entry
from msbot_xrce.lazy import dataclass

MOST_BITS: Final = 64
OBJECTS_FROM: Final = 0x20
"""Lower indices are data types: they stand for room that nobody uses."""


@dataclass(frozen=True, slots=True)
class PdoLayout:
    """A PDO: its identifier, and its entries from the lowest bit on."""

    number: int
    """From 1."""
    cob_id: int
    entries: tuple[Entry, ...]
    is_synchronous: bool = False
    """It is sent, or taken, when SYNC comes."""

    @property
    def octets(self) -> int:
        """How many it has."""
        return sum(entry.bits for entry in self.entries) + 7 >> 3

    def pack(self, values: Mapping[Entry, int]) -> bytes:
        """The octets; entries without a value are 0."""
        number = at = 0
        for entry in self.entries:
            value = max(entry.least, min(entry.most, values.get(entry, 0)))
            number |= (value & (1 << entry.bits) - 1) << at
            at += entry.bits
        return number.to_bytes(self.octets, "little")

    def unpack(self, data: bytes) -> dict[Entry, int]:
        """The values of all entries that the octets have in full."""
        number, at, values = int.from_bytes(data, "little"), 0, dict[Entry, int]()
        for entry in self.entries:
            if at + entry.bits > 8 * len(data):
                break
            value = number >> at & (1 << entry.bits) - 1
            if entry.signed and value >> entry.bits - 1:
                value -= 1 << entry.bits
            values[entry] = value
            at += entry.bits
        return values


def mapped_entries(mappings: Iterable[int], known: Mapping[tuple[int, int], Entry]) -> tuple[Entry, ...]:
    """Entries from what a PDO's mapping object holds; of those that are not known only the size is."""
    found = list[Entry]()
    for mapping in mappings:
        index, subindex, bits = mapping >> 16, mapping >> 8 & 0xFF, mapping & 0xFF
        entry = known.get((index, subindex))
        found.append(entry if entry is not None and entry.bits == bits else Entry(index, subindex, bits))
    return tuple(found)


def distribute(entries: Sequence[Entry], most_pdos: int) -> list[tuple[Entry, ...]]:
    """Entries in as few PDOs as hold them, in their order; those beyond the last PDO are left out."""
    pdos = list[list[Entry]]()
    for entry in entries:
        if not pdos or sum(one.bits for one in pdos[-1]) + entry.bits > MOST_BITS:
            if len(pdos) == most_pdos:
                break
            pdos.append([])
        pdos[-1].append(entry)
    return [tuple(pdo) for pdo in pdos]
