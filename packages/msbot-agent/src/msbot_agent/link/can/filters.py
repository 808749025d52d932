"""Which identifiers a link wants to receive: the kernel drops all others before they cost anything."""

from __future__ import annotations

from typing import Final

from msbot_agent.link.can.protocol.ids import NODES, CanIds
from msbot_xrce.lazy import dataclass

STANDARD_BITS: Final = 0x7FF
EXTENDED_BITS: Final = 0x1FFFFFFF


@dataclass(frozen=True, slots=True)
class IdFilter:
    """Data frames whose identifier equals `can_id` in the bits of `mask` (and is of that length) are received."""

    can_id: int
    mask: int
    extended: bool = False


def one_id(can_id: int, *, extended: bool = False) -> IdFilter:
    """Just that identifier."""
    return IdFilter(can_id, EXTENDED_BITS if extended else STANDARD_BITS, extended)


def id_range(first: int, last: int) -> list[IdFilter]:
    """The fewest filters for all 11-bit identifiers from `first` to `last`, and no others."""
    filters = []
    while first <= last:
        size = first & -first or STANDARD_BITS + 1
        while first + size - 1 > last:
            size >>= 1
        filters.append(IdFilter(first, STANDARD_BITS & ~(size - 1)))
        first += size
    return filters


def master_filters(ids: CanIds) -> tuple[IdFilter, ...]:
    """What `CanMasterLink` wants: data and JOIN of parts, beacons of other masters, STOP."""
    joining = IdFilter(ids.join, 0x1F000000, extended=True)
    return (one_id(ids.stop), one_id(ids.beacon), joining, *id_range(ids.up + 1, ids.up + NODES))


def part_filters(ids: CanIds) -> tuple[IdFilter, ...]:
    """What `CanPartLink` wants: data from the master, whatever the address, its beacon, ASSIGN, STOP."""
    assigning = IdFilter(ids.assign, 0x1F000000, extended=True)
    return (one_id(ids.stop), one_id(ids.beacon), assigning, *id_range(ids.down + 1, ids.down + NODES))


def legacy_filters(ids: CanIds, receive_id: int) -> tuple[IdFilter, ...]:
    """What `CanLegacyLink` wants: one identifier, and STOP."""
    return (one_id(ids.stop), one_id(receive_id))


def eprosima_filters(ids: CanIds, can_id: int | None) -> tuple[IdFilter, ...]:
    """What `CanFdEprosimaLink` wants: all extended identifiers, or on a client's side its own; and STOP."""
    clients = IdFilter(0, 0, extended=True) if can_id is None else one_id(can_id, extended=True)
    return (one_id(ids.stop), clients)
