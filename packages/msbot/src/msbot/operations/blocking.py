"""Blocks a part, or all parts of a part number, and lets them in again."""

from __future__ import annotations

from collections.abc import Hashable
from functools import partial

from msbot.master import Master
from msbot.operations.operation import Outcome, outcome_of
from msbot.operations.part_names import uid_of
from msbot.operations.running_robot import RunningRobot
from msbot.operations.stored_robot import StoredRobot
from msbot.pnp import KnownObject
from msbot.registry.edits import undo
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError


class Blocking:
    """Blocks in a running robot: parts that are in are put out at once."""

    def __init__(self, running: RunningRobot) -> None:
        self._running = running
        self._inventory = running.inventory

    async def block(self, part: str, reason: str, who: str) -> Outcome:
        """Keep out a part, or all parts of one part number."""
        kind, key, words = self._block_key(part)
        edit = await self._running.change(who, partial(undo.block, kind=kind, key=key, reason=reason))
        self._inventory.blocks_changed(self._running.now())
        return outcome_of(
            edit,
            said("{part} is blocked: {reason}", part=words, reason=reason)
            if reason
            else said("{part} is blocked", part=words),
        )

    async def unblock(self, part: str, who: str) -> Outcome:
        """Let a part, or all parts of a number, in again; they come back by themselves."""
        kind, key, words = self._block_key(part)
        uid, number = (bytes.fromhex(key), "") if kind == "uid" else (b"", key)
        if self._inventory.blocked(uid, number) is None:
            raise ConfigError(said("{part} is not blocked", part=words))
        edit = await self._running.change(who, partial(undo.unblock, kind=kind, key=key))
        return outcome_of(edit, said("{part} may come in again", part=words))

    def _block_key(self, word: str) -> tuple[str, str, str]:
        """(kind, key, words) of what a person wants to block."""
        library = self._running.library
        seen = {info.part_number for info in self._inventory.view(self._running.now())}
        if word in seen or (library is not None and library.get(word) is not None):
            return "number", word, said("part number {word}", word=word)
        if (uid := uid_of(word)) is not None:
            return "uid", uid.hex(), said("the part with UID {uid}", uid=uid.hex())
        found = self._inventory.find(word, self._running.now())
        info = found[0] if len(found) == 1 else self._running.part(word)  # even one that is gone
        if info.uid:
            return "uid", info.uid.hex(), said("{part} (UID {uid})", part=info.part, uid=info.uid.hex())
        raise ConfigError(
            said(
                "{part} has no UID by which it could be blocked: block its number, {part_number}",
                part=info.part,
                part_number=info.part_number,
            )
        )


class StoredBlocking:
    """Blocks in the database of a robot that is not running."""

    def __init__(self, stored: StoredRobot) -> None:
        self._stored = stored

    async def block(self, part: str, reason: str, who: str) -> Outcome:
        """Keep out a part, or all parts of one part number."""
        kind, key = self._block_key(part)
        return outcome_of(await self._stored.change(who, partial(undo.block, kind=kind, key=key, reason=reason)))

    async def unblock(self, part: str, who: str) -> Outcome:
        """Let a part, or all parts of a number, in again."""
        kind, key = self._block_key(part)
        uid, number = (bytes.fromhex(key), "") if kind == "uid" else (b"", key)
        if self._stored.store.blocked(uid, number) is None:
            raise ConfigError(said("{part} is not blocked", part=part))
        return outcome_of(await self._stored.change(who, partial(undo.unblock, kind=kind, key=key)))

    def _block_key(self, word: str) -> tuple[str, str]:
        numbers = {one.part_number for one in self._stored.parts()}
        if word in numbers or self._stored.store.part_type(word) is not None:
            return "number", word
        uid = uid_of(word) or self._stored.part(word).uid
        return "uid", uid.hex()


# What the parts on CAN buses have set up: whoever begins to watch a bus later asks, because he did not hear it.


class BusObjects:
    """Answers for one running robot."""

    def __init__(self, running: RunningRobot) -> None:
        self._running = running

    def objects(self) -> Outcome:
        """For each bus by its name the endpoints of its nodes, as lists of node, object id, topic, type, slot and port;
        and the message types of the robot with the kinds and the units of their fields, also of the types inside."""
        master, library = self._running.master, self._running.library
        buses: dict[str, list[list[object]]] = {link.info.name: [] for link in master.links if link.info.shared_bus}
        for bus, node, object_id, key, topic in master.agent.bus_endpoints():
            known = _known(master, key, topic)
            row = [node, object_id, known.topic, known.type_name, known.slot, known.port]
            buses.setdefault(bus, []).append(row)
        types = [
            {
                "name": one.name,
                "fields": {name: dict(fields) for name, fields in one.described().items()},
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
