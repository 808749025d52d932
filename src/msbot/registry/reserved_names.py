"""Names that no person can have: the program signs what it does by itself with them, in the journal and elsewhere."""

from __future__ import annotations

import unicodedata

from msbot.errors import ConfigError
from msbot.runtime.sentence import said

RESERVED = frozenset({
    "demo",  # whoever opens the link of `msbot demo`
    "msbot", "robot", "master", "inventory", "agent", "relay", "profile", "system", "root",
    "nobody", "somebody", "newcomer", "the bigger robot", "me", "",
})  # fmt: skip
"""As `_plain` writes them."""
BEGINNINGS = ("msbot ", "somebody at ", "guest of ", "(")
"""How such names begin; `guest of Ada` is somebody whom Ada has let in."""


def check_reserved(name: str) -> None:
    """Check that a new account does not take a name that the program uses itself.

    Raises:
        ConfigError: it does.
    """
    plain = _plain(name)
    if plain in RESERVED or plain.startswith(BEGINNINGS):
        raise ConfigError(
            said("{name!r} is a name that the robot uses for itself: choose another, with a surname for example",
                 name=name)
        )  # fmt: skip


def _plain(name: str) -> str:
    """A name without what people do not see: `Ｄemo` and `DEMO` are `demo`."""
    return " ".join(unicodedata.normalize("NFKC", name).casefold().split())
