"""What is lost when a part of another type fills a slot: parts of different makers that do the same. Pure."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from msbot.config.library.part_types import PartType
from msbot_agent.text.sentence import said
from msbot_agent.toml.table import Scalar
from msbot_xrce.lazy import dataclass


@dataclass(frozen=True, slots=True)
class Substitution:
    """A type in the place of another one."""

    ports: tuple[str, ...]
    """Ports that it lacks, or has with another direction or message."""
    wired: tuple[str, ...]
    """Those of them that are wired in the slot."""
    settings: tuple[str, ...]
    """Settings of the slot that it has not."""
    values: tuple[str, ...]
    """Settings whose value in the slot it does not take: another type, or out of its range."""

    @property
    def words(self) -> str:
        """What is lost, as the rest of a sentence; empty: nothing."""
        parts = []
        if self.ports:
            parts.append(said("ports {names}", names=", ".join(self.ports)))
        if self.settings:
            parts.append(said("settings {names}", names=", ".join(self.settings)))
        if self.values:
            parts.append(said("values of {names}, which it does not take", names=", ".join(self.values)))
        return "; ".join(parts)


def substitute(old: PartType, new: PartType, wired: Collection[str], values: Mapping[str, Scalar]) -> Substitution:
    """What is lost when a part of the type `new` fills a slot of the type `old`.

    Args:
        old: the type of the slot.
        new: the type of the part.
        wired: the ports that are wired in the slot.
        values: what the slot's settings are, where they are not the library's.
    """
    ports = tuple(
        port.name
        for port in old.ports
        if (own := new.port(port.name)) is None or (own.direction, own.type_name) != (port.direction, port.type_name)
    )
    settings, values_lost = [], []
    for parameter in old.parameters:
        its = new.parameter(parameter.name)
        if its is None:
            settings.append(parameter.name)
        elif its.fault(values.get(parameter.name, parameter.default)) is not None:
            values_lost.append(parameter.name)
    return Substitution(ports, tuple(name for name in ports if name in wired), tuple(settings), tuple(values_lost))
