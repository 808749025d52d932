"""Blocks a part, or all parts of a part number, and lets them in again."""

from __future__ import annotations

from functools import partial

from msbot.operations.outcome import Outcome, outcome_of
from msbot.operations.part_names import uid_of
from msbot.operations.running_robot import RunningRobot
from msbot.operations.stored_robot import StoredRobot
from msbot.registry.edits import blocks
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError


class Blocking:
    """Blocks in a running robot: parts that are in are put out at once."""

    def __init__(self, running: RunningRobot) -> None:
        self._running = running
        self._inventory = running.inventory

    async def block(self, part: str, reason: str, who: str) -> Outcome:
        """Keep a part, or all parts of a number, out."""
        kind, key, words = self._block_key(part)
        edit = await self._running.change(who, partial(blocks.block, kind=kind, key=key, reason=reason))
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
        edit = await self._running.change(who, partial(blocks.unblock, kind=kind, key=key))
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
        """Keep a part, or all parts of a number, out."""
        kind, key = self._block_key(part)
        return outcome_of(await self._stored.change(who, partial(blocks.block, kind=kind, key=key, reason=reason)))

    async def unblock(self, part: str, who: str) -> Outcome:
        """Let a part, or all parts of a number, in again."""
        kind, key = self._block_key(part)
        uid, number = (bytes.fromhex(key), "") if kind == "uid" else (b"", key)
        if self._stored.store.blocked(uid, number) is None:
            raise ConfigError(said("{part} is not blocked", part=part))
        return outcome_of(await self._stored.change(who, partial(blocks.unblock, kind=kind, key=key)))

    def _block_key(self, word: str) -> tuple[str, str]:
        numbers = {one.part_number for one in self._stored.parts()}
        if word in numbers or self._stored.store.part_type(word) is not None:
            return "number", word
        uid = uid_of(word) or self._stored.part(word).uid
        return "uid", uid.hex()
