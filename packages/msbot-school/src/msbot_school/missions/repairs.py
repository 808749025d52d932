"""What a person can have done to a robot that is ill, and which faults that mends."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from msbot_agent.text.sentence import said
from msbot_xrce.common.lazy_dataclass import dataclass
from msbot_xrce.errors import ConfigError


@dataclass(frozen=True, slots=True)
class Repair:
    """One thing that can be done."""

    name: str
    words: str
    mends: frozenset[str]
    """Kinds of faults that are over when it is done where they are."""
    at_part: bool = True
    """Whether it is done at a part, or at the robot as a whole."""


_ROWS = (
    Repair("plug-in", said("plug the part in again"), frozenset({"unplug"})),
    Repair("restart-part", said("switch the part off and on"), frozenset({"late", "slow-consumer"})),
    Repair("exchange-part", said("exchange the part for a good one"), frozenset({"stuck", "drift", "bus-off"})),
    Repair("right-part", said("put the right part in its place"), frozenset({"wrong-number", "wrong-key"})),
    Repair("remove-twin", said("take the second part with its identity away"), frozenset({"duplicate-identity"})),
    Repair("new-cable", said("lay another cable to the part"), frozenset({"loss"})),
    Repair("new-switch", said("exchange what is between the part and the master"),
           frozenset({"delay", "duplicates", "reordering"})),
    Repair("quiet-bus", said("take the stranger off the bus that sends and sends"), frozenset({"babbling"}),
           at_part=False),
    Repair("new-bus-cable", said("lay another bus cable, shielded and terminated"), frozenset({"bit-errors"}),
           at_part=False),
    Repair("restart-master", said("restart the master"), frozenset({"master-frozen"}), at_part=False),
    Repair("restart-database", said("start the database again"), frozenset({"database-gone"}), at_part=False),
)  # fmt: skip

REPAIRS: Final[Mapping[str, Repair]] = MappingProxyType({row.name: row for row in _ROWS})
"""Every repair by its name."""


def repair_named(name: str) -> Repair:
    """The repair of that name.

    Raises:
        ConfigError: there is none; the text lists them.
    """
    repair = REPAIRS.get(name)
    if repair is None:
        raise ConfigError(
            said("there is no repair {name!r}; there are {repairs}", name=name, repairs=", ".join(REPAIRS))
        )
    return repair
