"""Where people's programs are kept, what a program may be called and how long it and its blocks may be."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NoReturn, Protocol

from msbot.registry import ProgramRecord, ProgramSource, ProgramVersion, Registry
from msbot_agent.text.json_reading import read_json
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError

MAX_PROGRAM = 64 * 1024
"""Octets of a program."""
MAX_BLOCKS = 256 * 1024
"""Octets of the blocks that it is made of; a block has some 150."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,39}\.py")


class ProgramShelf(Protocol):
    """Keeps programs; every method raises RegistryError when it cannot."""

    async def of(self, owner: str) -> Sequence[ProgramRecord]:
        """The programs of a person, the one changed last first."""

    async def source(self, owner: str, name: str, number: int | None = None) -> ProgramSource:
        """A program, or an earlier version of it; raises NotThere."""

    async def versions(self, owner: str, name: str) -> Sequence[ProgramVersion]:
        """What is kept of a program, the newest first; raises NotThere."""

    async def keep(self, owner: str, name: str, source: ProgramSource) -> int:
        """Keep a program; returns its version."""

    async def remove(self, owner: str, name: str) -> None:
        """Forget a program; raises NotThere."""

    async def share(self, owner: str, name: str) -> str:
        """The word by which others may read a program; raises NotThere."""

    async def shared(self, word: str) -> tuple[str, str, ProgramSource]:
        """Owner, name and source of a shared program; raises NotThere."""


class RegistryShelf:
    """In the robot's database."""

    def __init__(self, registry: Registry) -> None:
        self._storage = registry.storage
        self._kept = registry.programs

    async def of(self, owner: str) -> Sequence[ProgramRecord]:
        """See `ProgramShelf`."""
        return await self._storage.in_time(self._kept.of, owner)

    async def source(self, owner: str, name: str, number: int | None = None) -> ProgramSource:
        """See `ProgramShelf`."""
        return await self._storage.in_time(self._kept.source, owner, name, number)

    async def versions(self, owner: str, name: str) -> Sequence[ProgramVersion]:
        """See `ProgramShelf`."""
        return await self._storage.in_time(self._kept.versions, owner, name)

    async def keep(self, owner: str, name: str, source: ProgramSource) -> int:
        """See `ProgramShelf`."""
        return await self._storage.in_time(self._kept.keep, owner, name, source)

    async def remove(self, owner: str, name: str) -> None:
        """See `ProgramShelf`."""
        await self._storage.in_time(self._kept.remove, owner, name)

    async def share(self, owner: str, name: str) -> str:
        """See `ProgramShelf`."""
        return await self._storage.in_time(self._kept.share, owner, name)

    async def shared(self, word: str) -> tuple[str, str, ProgramSource]:
        """See `ProgramShelf`."""
        return await self._storage.in_time(self._kept.shared, word)


class NoShelf:
    """A robot without a database keeps nothing; programs run all the same."""

    async def of(self, owner: str) -> Sequence[ProgramRecord]:  # noqa: ARG002 - nobody has any
        """See `ProgramShelf`."""
        return ()

    async def _refuse(self, *_: object) -> NoReturn:
        raise ConfigError(said("this robot has no database: programs are not kept, copy them elsewhere"))

    source = versions = keep = remove = share = shared = _refuse


def check_program(name: str, source: ProgramSource) -> None:
    """Check what somebody wants to keep.

    Raises:
        ConfigError: the name, the length or the form of the blocks will not do.
    """
    text = source.text
    if not _NAME.fullmatch(name):
        raise ConfigError(
            said("{name!r} is no name for a program: 1 to 40 letters, digits, - and _, then .py", name=name[:60])
        )
    size = len(text.encode("utf-8", "surrogatepass"))
    if size > MAX_PROGRAM:
        raise ConfigError(
            said(
                "a program has at most {most} kB; this one has {size} kB",
                most=MAX_PROGRAM // 1024,
                size=size // 1024 + 1,
            )
        )
    if "\0" in text or not _is_text(text):
        raise ConfigError(said("a program is text; this one holds characters that are none"))
    if source.blocks:
        _check_blocks(source.blocks)


def _check_blocks(blocks: str) -> None:
    """What is in them is looked at by the browser that opens them; here they are only not let grow, and are JSON."""
    size = len(blocks.encode("utf-8", "surrogatepass"))
    if size > MAX_BLOCKS:
        raise ConfigError(
            said(
                "the blocks of a program have at most {most} kB; these have {size} kB: make two programs of them",
                most=MAX_BLOCKS // 1024,
                size=size // 1024 + 1,
            )
        )
    try:
        is_table = isinstance(read_json(blocks), dict)
    except ValueError:
        is_table = False
    if not is_table or "\0" in blocks or not _is_text(blocks):
        raise ConfigError(said("the blocks of a program are a JSON object, as the page makes it; these are not"))


def _is_text(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:  # half of a pair of surrogates
        return False
    return True
