"""The changes of people as methods: `Hand(registry).place(robot, uid, "left", "Ann")`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from msbot.config import Scalar, SlotPort
from msbot.registry import EditKind, EditRecord, Registry, RobotRecord
from msbot.registry.edits import part_places, slot_values, users, wires
from msbot.registry.edits.undo import block, unblock, undo


class Hand:
    def __init__(self, registry: Registry) -> None:
        self._edits = registry.edits

    def set_value(self, robot: RobotRecord, slot: str, name: str, value: Scalar | None, who: str) -> EditRecord:
        return self._edits.make(robot, who, partial(slot_values.set_value, slot=slot, name=name, value=value))

    def place(
        self,
        robot: RobotRecord,
        uid: bytes,
        slot: str | None,
        who: str,
        *,
        words: str = "",
        by_hand: bool = True,
        before: dict[bytes, str | None] | None = None,
    ) -> EditRecord:
        making = partial(part_places.put, uid=uid, slot=slot, words=words, by_hand=by_hand, before=before)
        return self._edits.make(robot, who, making)

    def place_swap(self, robot: RobotRecord, uid: bytes, slot: str, who: str, *, other: bytes = b"") -> EditRecord:
        return self._edits.make(robot, who, partial(part_places.swap, uid=uid, slot=slot, other=other))

    def block(self, robot: RobotRecord, kind: str, key: str, reason: str, who: str) -> EditRecord:
        return self._edits.make(robot, who, partial(block, kind=kind, key=key, reason=reason))

    def unblock(self, robot: RobotRecord, kind: str, key: str, who: str) -> EditRecord:
        return self._edits.make(robot, who, partial(unblock, kind=kind, key=key))

    def bind(
        self,
        robot: RobotRecord,
        topic: str,
        who: str,
        *,
        type_name: str,
        source: SlotPort | None,
        targets: Sequence[SlotPort] = (),
        reliable: bool = True,
    ) -> EditRecord:
        making = partial(
            wires.bind, topic=topic, type_name=type_name, source=source, targets=targets, reliable=reliable
        )
        return self._edits.make(robot, who, making)

    def unbind(self, robot: RobotRecord, topic: str, endpoint: SlotPort | None, who: str) -> EditRecord:
        return self._edits.make(robot, who, partial(wires.unbind, topic=topic, endpoint=endpoint))

    def undo(self, robot: RobotRecord, number: int | None, who: str) -> EditRecord:
        return self._edits.make(robot, who, partial(undo, number=number))

    def note(self, robot: RobotRecord, kind: str, words: str, who: str) -> None:
        self._edits.note(robot, EditKind(kind), words, who)

    def keep_user(
        self, name: str, role: str, who: str, *, password_hash: str = "", tokens: tuple[tuple[str, str], ...] = ()
    ) -> EditRecord:
        person = users.Person(name, role, password_hash, tokens)
        return self._edits.make(None, who, partial(users.keep, people=[person]))

    def remove_user(self, name: str, who: str) -> EditRecord:
        return self._edits.make(None, who, partial(users.remove, name=name))
