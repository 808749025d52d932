"""The SD card of a Raspberry Pi that was flashed with MsBOT: what a root helper of it sets for the page.

The helper (`packaging/image`) has a socket, where it answers requests of one line of JSON. On any other computer there
is no such socket, and the page shows nothing of it.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Mapping
from pathlib import Path

from pydantic import Field

from msbot_agent.text.sentence import said
from msbot_web.models.robot_models import Model
from msbot_xrce.errors import ConfigError, NotThere

SOCKET = Path("/run/msbot-card.socket")
PACKAGE = Path("/var/lib/msbot/update.deb")
"""Where an update is put for the helper: among the robot's data."""
LARGEST_ANSWER = 262_144
ANSWER_S, UNPACK_S = 30.0, 600.0
"""How long the helper may take; for an update longer, because it unpacks it."""
REASONS = {
    "name": said("The computer's name has small letters, digits and hyphens, e.g. msbot-3."),
    "network": said("The Wi-Fi needs a country and a network, whose name has at most 32 octets."),
    "country": said("The Wi-Fi's country has two capital letters, e.g. DE."),
    "password": said("A Wi-Fi password has 8 to 63 letters, digits and signs."),
    "can": said("This CAN hat or bit rate is not known."),
    "package": said("This file is no update: it has to be msbot_VERSION_arm64.deb, whole, for this card's Debian."),
    "running": said("This version is here already."),
    "trial": said("An update is being tried: wait until it is done."),
    "former": said("There is no former version."),
}
"""What the helper refuses, in words that can be translated; its own words say more, in the log."""


class CardSettings(Model):
    """What can be set about the card."""

    name: str
    """Of the computer: its page is at http://NAME.local."""
    country: str
    """Of the Wi-Fi; empty: there is no Wi-Fi."""
    network: str
    """The Wi-Fi's name."""
    has_key: bool
    """Whether a password of the Wi-Fi is kept."""
    i2c: bool
    can: str
    """The chip and the crystal of a CAN hat; `none`."""
    can_bitrate: int


class CardVersions(Model):
    """Which version of MsBOT runs from the card; empty: that of the image."""

    current: str
    former: str
    trial: bool
    """It has not been seen well yet."""
    starts: int
    back: bool
    """The next start goes back to the former one."""
    told: str
    """What happened last: `updated`, `fell back`, `went back`."""


class CardState(Model):
    """The card as it is."""

    settings: CardSettings
    wifi: bool
    """Whether this computer has Wi-Fi."""
    can: bool
    """Whether the CAN hat has been found."""
    i2c: bool
    mistakes: str
    """What was wrong with the set-up file."""
    versions: CardVersions


class CardWifi(Model):
    """A Wi-Fi network."""

    country: str = Field(max_length=2)
    network: str = Field(max_length=32)
    password: str | None = Field(default=None, max_length=63)
    """None: as it is; empty: a network without a password."""


class CardHardware(Model):
    """What is plugged onto the pins."""

    i2c: bool | None = None
    can: str | None = Field(default=None, max_length=32)
    can_bitrate: int | None = None


class CardChange(Model):
    """What is to be set; what is absent stays."""

    name: str | None = Field(default=None, max_length=63)
    wifi: CardWifi | None = None
    hardware: CardHardware | None = None


class SdCard:
    """Asks the helper.

    Args:
        socket: where it listens.
        package: where an update is put for it.
    """

    def __init__(self, socket: Path = SOCKET, package: Path = PACKAGE) -> None:
        self._socket = socket
        self._package = package
        self._updating = asyncio.Lock()

    @property
    def is_there(self) -> bool:
        """Whether this computer runs from such a card."""
        return self._socket.is_socket()

    async def state(self) -> CardState:
        """The card as it is.

        Raises:
            NotThere: there is no such card.
            ConfigError: the helper does not answer.
        """
        return CardState.model_validate(await self._ask({"do": "state"}))

    async def change(self, wanted: CardChange) -> CardState:
        """Set something.

        Raises:
            ConfigError: it makes no sense, or the helper does not answer.
        """
        settings = wanted.model_dump(exclude_none=True)
        return CardState.model_validate(await self._ask({"do": "change", "settings": settings}))

    async def update(self, package: AsyncIterator[bytes], running: str) -> CardState:
        """Take a package in, which runs from the next start on.

        Args:
            package: its octets, as they come in.
            running: the version of MsBOT that runs.

        Raises:
            ConfigError: it is no update, or another one is being taken in.
        """
        self._check_there()
        if self._updating.locked():
            raise ConfigError(REASONS["trial"])
        async with self._updating:
            try:
                with await asyncio.to_thread(self._package.open, "wb") as file:
                    async for octets in package:
                        await asyncio.to_thread(file.write, octets)
                asked = {"do": "update", "running": running}
                return CardState.model_validate(await self._ask(asked, within_s=UNPACK_S))
            except OSError as error:
                raise ConfigError(
                    said("the update cannot be kept: {reason}", reason=error.strerror or str(error))
                ) from None
            finally:
                await asyncio.to_thread(self._package.unlink, missing_ok=True)

    async def go_back(self) -> CardState:
        """Have the next start go back to the former version.

        Raises:
            ConfigError: there is none.
        """
        return CardState.model_validate(await self._ask({"do": "back"}))

    async def restart(self) -> None:
        """Start the computer again.

        Raises:
            ConfigError: the helper does not answer.
        """
        await self._ask({"do": "restart"})

    def _check_there(self) -> None:
        if not self.is_there:
            raise NotThere(said("this computer does not run from a card of MsBOT"))

    async def _ask(self, request: Mapping[str, object], within_s: float = ANSWER_S) -> object:
        self._check_there()
        try:
            async with asyncio.timeout(within_s):
                reader, writer = await asyncio.open_unix_connection(self._socket, limit=LARGEST_ANSWER)
                try:
                    writer.write(json.dumps(request).encode() + b"\n")
                    await writer.drain()
                    answer = json.loads(await reader.readuntil(b"\n"))
                finally:
                    writer.close()
        except (OSError, EOFError, ValueError, asyncio.LimitOverrunError, TimeoutError):
            raise ConfigError(said("the helper of the card does not answer: start the computer again")) from None
        if not isinstance(answer, dict) or "done" not in answer:
            reason = str(answer.get("reason")) if isinstance(answer, dict) else ""
            words = str(answer.get("error")) if isinstance(answer, dict) else ""
            raise ConfigError(REASONS.get(reason) or said("the card refuses: {words}", words=words[:500]))
        return answer["done"]
