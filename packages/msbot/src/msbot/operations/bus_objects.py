"""What the parts on CAN buses have set up: whoever begins to watch a bus later asks, because he did not hear it."""

from __future__ import annotations

from collections.abc import Hashable

from msbot.master import Master
from msbot.operations.outcome import Outcome
from msbot.operations.running_robot import RunningRobot
from msbot.pnp import KnownObject


class BusObjects:
    """Answers for one running robot."""

    def __init__(self, running: RunningRobot) -> None:
        self._running = running

    def objects(self) -> Outcome:
        """For each bus by its name the endpoints of its nodes, as lists of node, object id, topic, type, slot and port;
        and the message types of the robot with the kinds and the units of their fields."""
        master, library = self._running.master, self._running.library
        buses: dict[str, list[list[object]]] = {link.info.name: [] for link in master.links if link.info.shared_bus}
        for bus, node, object_id, key, topic in master.agent.bus_endpoints():
            known = _known(master, key, topic)
            row = [node, object_id, known.topic, known.type_name, known.slot, known.port]
            buses.setdefault(bus, []).append(row)
        types = [
            {
                "name": one.name,
                "fields": {name: kind.value for name, kind in one.fields.items()},
                "units": {**one.units},
            }
            for one in ({} if library is None else library.messages).values()
        ]
        return Outcome(answer={"buses": buses, "types": types})


def known_object(master: Master, node: Hashable, object_id: int) -> KnownObject | None:
    """What the master knows about an object of the client at a node whose creation nobody heard."""
    found = master.agent.topic_at(node, object_id)
    return None if found is None else _known(master, *found)


def _known(master: Master, key: int, topic: str) -> KnownObject:
    configuration = master.inventory.configuration_of(key)
    for binding in () if configuration is None else configuration.bindings:
        if binding.topic == topic and configuration is not None:
            return KnownObject(topic, binding.type_name, configuration.slot, binding.port)
    return KnownObject(topic, slot="" if configuration is None else configuration.slot)
