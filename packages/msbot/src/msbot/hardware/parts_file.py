"""`parts.toml`: which parts are wired to this computer, one table `[[part]]` each."""

from __future__ import annotations

from pathlib import Path

from msbot.config import Library, PartType
from msbot.hardware.wiring import PartWiring, make_wiring
from msbot_agent.toml.document import read_document
from msbot_agent.toml.problems import Problems
from msbot_agent.toml.table import Table
from msbot_xrce.common.lazy_dataclass import dataclass
from msbot_xrce.errors import ConfigError

MOST_PARTS = 64
"""Most parts of one file: a Raspberry Pi has 28 pins, and each part has a session of its own with the master."""


@dataclass(frozen=True, slots=True)
class HostedPart:
    """One part of the file."""

    name: str
    """The name of the part, unique in the file."""
    part_type: PartType
    number: str
    """The part number that it shows, perhaps with a version."""
    wiring: PartWiring | None
    """None: it is simulated."""
    key: str = ""
    """File with its key, or the key itself."""


def read_parts(path: Path, library: Library) -> list[HostedPart]:
    """The parts of a file.

    Raises:
        ConfigError: something is wrong; every problem is reported at once, with file and line.
    """
    problems = Problems()
    document = read_document(path, problems, if_missing="write one, see docs/howto/raspberry_pi.md")
    problems.raise_if_any()
    assert document is not None
    table = Table(document, problems, document.values)
    tables = table.tables("part")
    table.finish()
    parts: list[HostedPart] = []
    claims: dict[str, str] = {}
    if len(tables) > MOST_PARTS:
        table.problem(f"there are {len(tables)} parts; {MOST_PARTS} can be in one file", "part")
        problems.raise_if_any()
    for entry in tables:
        part = _read_part(entry, library)
        if part is None:
            continue
        if part.name in [other.name for other in parts]:
            entry.problem(f'there are two parts with the name "{part.name}"; give each a name of its own', "name")
            continue
        for claim in part.wiring.claims() if part.wiring is not None else ():
            if (other := claims.setdefault(claim, part.name)) != part.name:
                entry.problem(f"{claim} is taken by {other}; wire one of them elsewhere")
        parts.append(part)
    problems.raise_if_any()
    return parts


def _read_part(table: Table, library: Library) -> HostedPart | None:
    number = table.name("type", "HC-SR04")
    name = table.name("name", "front", default=number or "part")
    simulate = table.flag("simulate", default=False)
    pins, adc, options = (table.scalars(key) for key in ("pins", "adc", "options"))
    i2c, device = table.text("i2c", "1:0x76"), table.text("device", "/dev/ttyACM0")
    key = table.text("key", "front.key")
    table.finish()
    if not number:
        return None
    try:
        part_type = library.require(number)
        wiring = None
        if not simulate:
            wiring = make_wiring(part_type, pins=pins, adc=adc, i2c=i2c, device=device, options=options)
    except ConfigError as error:
        table.problem(str(error), "type")
        return None
    return HostedPart(name, part_type, number, wiring, key)
