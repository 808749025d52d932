"""What people, groups and tokens may be called: by names that fit into an address and that people can tell apart.

New names are checked; what a database has already stays usable as it is. Some names nobody can have, as the program
signs what it does by itself with them, in the journal and elsewhere.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable
from functools import lru_cache

from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError

LONGEST_NAME = 64
"""Characters of a name."""
RESERVED = frozenset({
    "demo",  # whoever opens the link of `msbot demo`
    "msbot", "robot", "master", "inventory", "agent", "relay", "profile", "system", "root",
    "nobody", "somebody", "newcomer", "the bigger robot", "me", "",
})  # fmt: skip
"""As `_plain` writes them."""
BEGINNINGS = ("msbot ", "somebody at ", "guest of ", "(")
"""How such names begin; `guest of Ada` is somebody whom Ada has let in."""

_OF_ADDRESSES = "/\\?#%"
"""Signs that mean something in an address."""
_SEEN_AS_NOTHING = frozenset("\u034f\u115f\u1160\u17b4\u17b5\u2800\u3164\uffa0") | {
    chr(sign)
    for first, last in ((0x180B, 0x180F), (0xFE00, 0xFE0F), (0xE0100, 0xE01EF))
    for sign in range(first, last + 1)
}
"""Letters and marks that Python counts as printable, and that nobody sees."""
_ALIKE = ("LATIN", "GREEK", "CYRILLIC", "ARMENIAN", "CHEROKEE", "COPTIC", "LISU")
"""Scripts with letters that look like those of another one; the first word of a letter's name in Unicode."""
_LOOKS_LIKE = str.maketrans("аеорсухіјѕԁһӏԛԝьгвнкмтαορνυικτ", "aeopcyxijsdhlqwbrbhkmtaopvuikt")
"""Small Cyrillic and Greek letters, and the Latin ones that they are taken for."""


def check_reserved(name: str) -> None:
    """Check that a new account does not take a name that the program uses itself.

    Raises:
        ConfigError: it does.
    """
    plain = _plain(name)
    if plain in RESERVED or plain.startswith(BEGINNINGS):
        raise ConfigError(
            said(
                "{name!r} is a name that the robot uses for itself: choose another, with a surname for example",
                name=name,
            )
        )


def check_name(name: str, others: Iterable[str] = ()) -> None:
    """Check that people can tell a new name from others, and that it can stand in an address.

    Raises:
        ConfigError: they cannot, or it looks like one of `others`, which may hold the name itself.
    """
    if not name or len(name) > LONGEST_NAME or name != name.strip() or not name.isprintable():
        raise ConfigError(
            said(
                "{name!r} is no name: 1 to {most} printable characters, without blanks around it",
                name=name[:LONGEST_NAME],
                most=LONGEST_NAME,
            )
        )
    if any(sign in name for sign in _OF_ADDRESSES) or not name.strip("."):
        raise ConfigError(
            said(
                "{name!r} cannot stand in an address: a name has none of {signs}, and more than dots",
                name=name,
                signs=" ".join(_OF_ADDRESSES),
            )
        )
    if not _SEEN_AS_NOTHING.isdisjoint(name):
        raise ConfigError(said("{name!r} has a letter that nobody sees: type the name anew", name=ascii(name)))
    for word in name.split():
        if len(scripts := {script for sign in word if (script := _script(sign))}) > 1:
            raise ConfigError(
                said(
                    "{name!r} mixes letters that look alike, {scripts}: write each word in one alphabet",
                    name=name,
                    scripts=", ".join(sorted(script.capitalize() for script in scripts)),
                )
            )
    seen = _as_seen(name)
    for other in others:
        if other != name and _as_seen(other) == seen:
            raise ConfigError(
                said("{name!r} looks like {other!r}, which is there already: choose another", name=name, other=other)
            )


def _plain(name: str) -> str:
    """A name without what people do not see: `Ｄemo` and `DEMO` are `demo`."""
    return " ".join(unicodedata.normalize("NFKC", name).casefold().split())


@lru_cache(4096)  # a class list of 1,000 is compared with 1,000 people
def _as_seen(name: str) -> str:
    """The same for names that look alike."""
    return _plain(name).translate(_LOOKS_LIKE)


def _script(sign: str) -> str:
    """Which of the alphabets that look alike a letter is of; empty: none."""
    first = unicodedata.name(sign, "").partition(" ")[0] if sign.isalpha() else ""
    return first if first in _ALIKE else ""
