"""The units of curves, which the part library knows and recordings do not."""

from __future__ import annotations

from msbot.config import Library
from msbot.recording.curves.names import field_name
from msbot.recording.curves.reading import UnitOf


def units_of(library: Library) -> UnitOf:
    """The units of messages' fields and of parts' settings."""
    known = {
        (name, field_name(field)): unit for name in library.messages for field, unit in library.units(name).items()
    }
    known |= {(f":{entry.number}", one.name): one.unit for entry in library for one in entry.parameters if one.unit}

    def unit_of(kind: str, field: str) -> str:
        return known.get((kind, field), "") or known.get((kind, field_name(field)), "")

    return unit_of
