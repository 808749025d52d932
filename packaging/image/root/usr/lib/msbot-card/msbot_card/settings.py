"""What a person may set about the card, in `msbot-setup.toml` or on the page; and the file that keeps it. Pure."""

from __future__ import annotations

import hashlib
import json
import re
import tomllib
from dataclasses import asdict, dataclass, field, replace
from typing import TypeVar

_T = TypeVar("_T", bool, int)

LARGEST = 20_000
"""Octets of a set-up file."""
NAME = re.compile(r"[a-z0-9]([a-z0-9-]{0,61}[a-z0-9])?")
COUNTRY = re.compile(r"[A-Z]{2}")
PRE_SHARED_KEY = re.compile(r"[0-9a-f]{64}")
CAN_HATS = {
    "none": "",
    "mcp2515-8mhz": "msbot-mcp2515,oscillator=8000000",
    "mcp2515-12mhz": "msbot-mcp2515,oscillator=12000000",
    "mcp2515-16mhz": "msbot-mcp2515,oscillator=16000000",
    "mcp2518fd-20mhz": "msbot-mcp251xfd,oscillator=20000000",
    "mcp2518fd-40mhz": "msbot-mcp251xfd,oscillator=40000000",
}
"""Chip and crystal of a CAN hat, and its line in config.txt."""
LOWEST_BITRATE, HIGHEST_BITRATE = 10_000, 1_000_000


class SettingsError(Exception):
    """A setting makes no sense; the text says which, and what would be right.

    Args:
        words: the text.
        reason: a word for it, by which the page finds a translation.
    """

    def __init__(self, words: str, reason: str = "") -> None:
        super().__init__(words)
        self.reason = reason


@dataclass(frozen=True, slots=True)
class Settings:
    """What is set."""

    name: str = "msbot"
    """Of the computer: its page is http://NAME.local."""
    country: str = ""
    """Where the Wi-Fi is on the air, e.g. DE; empty: no Wi-Fi."""
    network: str = ""
    """The Wi-Fi's name."""
    key: str = ""
    """What proves the password of the Wi-Fi, made of it; empty: a network without one."""
    i2c: bool = False
    can: str = "none"
    """One of CAN_HATS."""
    can_bitrate: int = 500_000


@dataclass(frozen=True, slots=True)
class Administrator:
    """Who is to administer the page."""

    name: str
    password: str = field(repr=False)


TABLES = {
    "": ("name",),
    "administrator": ("name", "password"),
    "wifi": ("country", "network", "password"),
    "hardware": ("i2c", "can", "can_bitrate"),
}
"""The keys of a set-up file."""


def pre_shared_key(network: str, password: str) -> str:
    """What WPA2 makes of a password (IEEE 802.11-2020, J.4.1): the password itself is not kept.

    Raises:
        SettingsError: it is too short, too long, or has other characters than WPA2 allows.
    """
    if not 8 <= len(password) <= 63 or not (password.isascii() and password.isprintable()):
        raise SettingsError("wifi.password: 8 to 63 printable ASCII characters are a WPA2 password", "password")
    return hashlib.pbkdf2_hmac("sha1", password.encode(), network.encode(), 4096, 32).hex()


def checked(settings: Settings) -> Settings:
    """The same settings.

    Raises:
        SettingsError: one of them makes no sense.
    """
    if not NAME.fullmatch(settings.name):
        raise SettingsError("name: 1 to 63 small letters, digits and hyphens, e.g. msbot-3", "name")
    if bool(settings.country) != bool(settings.network):
        raise SettingsError("wifi: country and network belong together", "network")
    if settings.country and not COUNTRY.fullmatch(settings.country):
        raise SettingsError("wifi.country: two capital letters, e.g. DE", "country")
    if len(settings.network.encode()) > 32 or not settings.network.isprintable():
        raise SettingsError("wifi.network: at most 32 octets, without control characters", "network")
    if settings.key and not PRE_SHARED_KEY.fullmatch(settings.key):
        raise SettingsError("wifi: 64 hexadecimal digits are a key")
    if settings.can not in CAN_HATS:
        raise SettingsError(f"hardware.can: one of {', '.join(CAN_HATS)}", "can")
    if not LOWEST_BITRATE <= settings.can_bitrate <= HIGHEST_BITRATE:
        raise SettingsError(f"hardware.can_bitrate: {LOWEST_BITRATE} to {HIGHEST_BITRATE} bit/s", "can")
    return settings


def parse(text: bytes, before: Settings) -> tuple[Settings, Administrator | None]:
    """A set-up file.

    Args:
        text: the file.
        before: what is set already; the file changes what it names.

    Raises:
        SettingsError: it is no TOML file, or something in it makes no sense.
    """
    if len(text) > LARGEST:
        raise SettingsError(f"the file has {len(text)} octets; at most {LARGEST} are read")
    try:
        table = tomllib.loads(text.decode("utf-8-sig").replace("\r\n", "\n"))
    except UnicodeDecodeError as error:
        raise SettingsError(f"the file is not UTF-8 (octet {error.start + 1}): save it as UTF-8") from None
    except tomllib.TOMLDecodeError as error:
        raise SettingsError(f"the file is not TOML: {error}") from None
    return changed(table, before)


def changed(table: object, before: Settings) -> tuple[Settings, Administrator | None]:
    """What a table of settings makes of those before.

    Raises:
        SettingsError: something in it makes no sense.
    """
    tables = _tables(table)
    own, wifi, hardware, person = (tables[name] for name in ("", "wifi", "hardware", "administrator"))
    after = replace(before, name=_text(own, "name", "name", before.name))
    if wifi:
        network = _text(wifi, "wifi.network", "network", before.network)
        country = _text(wifi, "wifi.country", "country", before.country)
        password = _text(wifi, "wifi.password", "password", "")
        key = before.key if "password" not in wifi and network == before.network else ""
        after = replace(
            after, country=country, network=network, key=pre_shared_key(network, password) if password else key
        )
    after = replace(
        after,
        i2c=_value(hardware, "i2c", before.i2c, bool, "true or false"),
        can=_text(hardware, "hardware.can", "can", before.can),
        can_bitrate=_value(hardware, "can_bitrate", before.can_bitrate, int, "a number"),
    )
    administrator = None
    if person:
        administrator = Administrator(
            _text(person, "administrator.name", "name", ""), _text(person, "administrator.password", "password", "")
        )
        if not administrator.name or len(administrator.password) < 8:
            raise SettingsError("administrator: needs a name, and a password of at least 8 characters")
    return checked(after), administrator


def _tables(table: object) -> dict[str, dict[str, object]]:
    if not isinstance(table, dict):
        raise SettingsError("settings are a table")
    tables: dict[str, dict[str, object]] = {name: {} for name in TABLES}
    for key, value in table.items():
        if key in TABLES[""]:
            tables[""][key] = value
        elif key not in TABLES:
            allowed = [*TABLES[""], *(f"[{name}]" for name in TABLES if name)]
            raise SettingsError(f"{key!r} is not known; known are {', '.join(allowed)}")
        elif not isinstance(value, dict):
            raise SettingsError(f"{key}: a table, [{key}]")
        else:
            for name in value:
                if name not in TABLES[key]:
                    raise SettingsError(f"{key}.{name} is not known; known are {', '.join(TABLES[key])}")
            tables[key] = value
    return tables


def _text(table: dict[str, object], place: str, key: str, default: str) -> str:
    value = table.get(key, default)
    if not isinstance(value, str) or len(value) > 200:
        raise SettingsError(f'{place}: a text in quotes, as in {key} = "..."')
    return value


def _value(table: dict[str, object], key: str, default: _T, kind: type[_T], wanted: str) -> _T:
    value = table.get(key, default)
    if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
        raise SettingsError(f"hardware.{key}: {wanted}")
    return value


def load(text: bytes) -> Settings:
    """The settings that are kept.

    Raises:
        SettingsError: the file is damaged.
    """
    try:
        table = json.loads(text)
        return checked(Settings(**table))
    except (ValueError, TypeError, AttributeError) as error:
        raise SettingsError(f"the settings that were kept are damaged: {error}") from None


def dump(settings: Settings) -> bytes:
    """The settings as they are kept."""
    return json.dumps(asdict(settings), indent=1).encode()
