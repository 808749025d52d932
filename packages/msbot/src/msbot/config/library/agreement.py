"""What must agree between part types: which one can stand in for which other."""

from __future__ import annotations

from collections.abc import Mapping

from msbot.config.library.part_types import PartType
from msbot_agent.toml.problems import quoted, suggestion
from msbot_agent.toml.table import Table

Entries = Mapping[str, tuple[Table, PartType]]
"""Part types by number, each with the table it was read from."""


def check_agreement(entries: Entries) -> None:
    """Note every `compatible_with` that names no type, is circular, or contradicts the ports."""
    circles: set[frozenset[str]] = set()
    for number, (table, part_type) in entries.items():
        for position, other in enumerate(part_type.compatible_with):
            if other in entries:
                _check_ports(table, part_type, entries[other][1], position)
            elif other:
                right = suggestion(other, sorted(entries), none_known="remove it")
                table.report(f'the library has no part number "{other}"; {right}', "compatible_with", position)
        circle = _circle(entries, number)
        if circle and frozenset(circle) not in circles:
            circles.add(frozenset(circle))
            words = " -> ".join((*circle, circle[0]))
            table.report(
                f"goes round in a circle: {words}; of two types that fit each other, let the newer name the older one",
                "compatible_with",
            )


def _check_ports(table: Table, part_type: PartType, other: PartType, position: int) -> None:
    missing = [
        port.name
        for port in other.ports
        if port.name not in part_type.lacks
        if (own := part_type.port(port.name)) is None
        or (own.direction, own.type_name) != (port.direction, port.type_name)
    ]
    if missing:
        table.report(
            f'cannot fill a slot for "{other.number}": that one has {quoted(missing)}, which this one lacks or has '
            "with another direction or type; add the port, name it in lacks, or remove the number",
            "compatible_with",
            position,
        )


def _circle(entries: Entries, start: str) -> list[str]:
    """The numbers of a circle that begins and ends at `start`; empty if there is none."""
    ways: list[list[str]] = [[start]]
    seen: set[str] = set()
    while ways:
        way = ways.pop()
        for other in entries[way[-1]][1].compatible_with if way[-1] in entries else ():
            if other == start:
                return way
            if other not in seen:
                seen.add(other)
                ways.append([*way, other])
    return []
