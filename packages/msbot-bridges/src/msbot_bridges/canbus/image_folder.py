"""The images of new software that a person has put into a folder.

The folder is looked at in a thread, now and then: the event loop, and a thread that has a bus, do not wait for a disk.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from itertools import islice
from pathlib import Path
from typing import Final

from msbot_xrce.errors import ConfigError

MOST_OCTETS: Final = 16 * 1024 * 1024
"""Of an image."""
LONGEST_NAME: Final = 80
MOST_LISTED: Final = 10
MOST_IMAGES: Final = 1000
"""Of a folder; further files are not seen."""
LOOK_S: Final = 1.0
"""So often the folder is looked at."""


class ImageFolder:
    """See the module's docstring.

    Args:
        folder: the folder.

    Raises:
        ConfigError: there is no such folder.
    """

    def __init__(self, folder: Path) -> None:
        if not folder.is_dir():
            raise ConfigError(f"--option software={folder}: there is no such folder; name one with images for nodes")
        self._folder = folder
        self._names: list[str] = []
        self._trouble = ""

    def look(self) -> None:
        """See which images there are now; waits for the disk."""
        try:
            found = (one.name for one in self._folder.iterdir() if one.is_file() and not one.name.startswith("."))
            self._names, self._trouble = sorted(islice(found, MOST_IMAGES)), ""
        except OSError as error:
            self._names, self._trouble = [], f"the folder {self._folder} cannot be read ({error.strerror})"

    @asynccontextmanager
    async def watched(self) -> AsyncIterator[None]:
        """Look at the folder every second, in a thread, as long as the block runs."""
        await asyncio.to_thread(self.look)
        looking = asyncio.create_task(self._look_again())
        try:
            yield
        finally:
            looking.cancel()
            await asyncio.wait([looking])

    async def _look_again(self) -> None:
        while True:
            await asyncio.sleep(LOOK_S)
            await asyncio.to_thread(self.look)

    def check(self, name: str) -> None:
        """Refuse a name that is none of those seen last; does not wait for the disk.

        Raises:
            ConfigError: the text says which there are.
        """
        if self._trouble:
            raise ConfigError(self._trouble)
        if name not in self._names:
            known = ", ".join(self._names[:MOST_LISTED]) + (", ..." if len(self._names) > MOST_LISTED else "")
            raise ConfigError(f'there is no image "{name}"; there are: {known or "none"}')
        if len(name.encode()) > LONGEST_NAME:
            raise ConfigError(f"the name of the image has more than {LONGEST_NAME} octets; give it a shorter one")

    def read(self, name: str) -> bytes:
        """The octets of an image; waits for the disk.

        Raises:
            ConfigError: it is empty, too big, or cannot be read.
        """
        self.look()
        self.check(name)
        try:
            with (self._folder / name).open("rb") as file:
                octets = file.read(MOST_OCTETS + 1)
        except OSError as error:
            raise ConfigError(f"the image {name} cannot be read ({error.strerror})") from error
        if not octets or len(octets) > MOST_OCTETS:
            raise ConfigError(f"the image {name} has no octets, or more than {MOST_OCTETS:,}; no node can take it")
        return octets
