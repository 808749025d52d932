"""What the masters of this computer know of a bus: the dump did not hear what parts set up before it began."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import field
from typing import Any

from msbot.cli.bus.source import open_bus
from msbot.cli.robot_options import user_name
from msbot.config import FieldKind, MessageType
from msbot.pnp import KnownObject
from msbot_agent.agent import MASTER, RunningProcess, running_processes
from msbot_xrce.common.lazy_dataclass import dataclass
from msbot_xrce.errors import ConfigError


@dataclass(slots=True)
class RobotOnBus:
    """The objects and message types of the robot, or the robots, on a bus."""

    objects: dict[tuple[Hashable, int], KnownObject] = field(default_factory=dict)
    """By node and object id."""
    types: dict[str, MessageType] = field(default_factory=dict)
    """By name."""

    def know(self, node: Hashable, object_id: int) -> KnownObject | None:
        """An object of the client at a node."""
        return self.objects.get((node, object_id))


def robot_on_bus(address: str, complain: Callable[[str], None]) -> RobotOnBus | None:
    """Ask the masters that run on this computer; None: none of them serves that bus, which is said.

    Args:
        address: the bus.
        complain: takes what is wrong.

    Raises:
        ConfigError: the folder in which masters leave word is not the user's own.
    """
    bus = open_bus(address, node="dump", listen_only=True).info.name
    found = RobotOnBus()
    served = False
    for process in running_processes():
        try:
            served |= process.what == MASTER and _add(found, process, bus)
        except ConfigError as error:
            complain(str(error))
    if served:
        return found
    complain(f"no master on this computer serves {bus}: what joined before has no sentences until it joins again")
    return None


def _add(found: RobotOnBus, process: RunningProcess, bus: str) -> bool:
    """Add what a master knows of a bus; whether it serves that bus."""
    answer = process.ask({"do": "objects", "args": {}, "who": user_name()})
    try:
        rows = _mapping(answer.get("buses", {})).get(bus)
        if rows is None:
            return False
        for node, object_id, *words in rows:
            found.objects.setdefault((int(node), int(object_id)), KnownObject(*map(str, words)))
        types: Any = answer.get("types", ())
        for one in types:
            fields = {str(name): FieldKind(kind) for name, kind in _mapping(one["fields"]).items()}
            units = {str(name): str(unit) for name, unit in _mapping(one["units"]).items()}
            found.types.setdefault(str(one["name"]), MessageType(str(one["name"]), fields, units))
    except (ValueError, TypeError, KeyError) as error:
        raise ConfigError(
            f"{process.what} {process.name}: its answer about {bus} makes no sense ({error!r})"
        ) from error
    return True


def _mapping(value: object) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise TypeError("no JSON object")
    return value
