"""Browsers in which a person has signed in, each with a random word of its own in a cookie. Pure.

Wrong passwords from a known browser are counted for that browser alone: guesses made anywhere else do not keep its
person out, and guesses made in it keep nobody out elsewhere. A word ends when the person signs out there, when the
password changes, and when the account is removed. The master knows only its SHA-256.
"""

from __future__ import annotations

import secrets
from collections import Counter
from collections.abc import Iterable

from msbot_web.access.sessions import digest_of

MOST_OF_ONE = 20
"""Known browsers of one person; beyond that the one that was used the longest ago is known no more."""
MOST_KNOWN = 2000
"""The same for all; beyond that the person with the most loses one."""


class KnownBrowsers:
    """See the module's docstring."""

    def __init__(self) -> None:
        self._names: dict[str, str] = {}
        """Who has signed in, by the SHA-256 of the browser's word; the last used last."""

    def find(self, word: str, name: str) -> str:
        """What names that browser if this person has signed in there, else empty."""
        digest = digest_of(word) if word else ""
        return digest if self._names.get(digest) == name else ""

    def use(self, word: str, name: str) -> str:
        """That person has signed in with that browser.

        Args:
            word: what its cookie says; empty: nothing.
            name: who.

        Returns:
            What its cookie has to say from now on.
        """
        if not self.find(word, name):
            word = secrets.token_urlsafe(32)
        digest = digest_of(word)
        self._names.pop(digest, None)
        self._names[digest] = name
        self._drop_one(name)
        return word

    def end(self, word: str) -> None:
        """The person has signed out there."""
        if word:
            self._names.pop(digest_of(word), None)

    def end_all_of(self, name: str) -> None:
        """None of that person's browsers is known any more."""
        self._names = {digest: one for digest, one in self._names.items() if one != name}

    def kept(self) -> list[tuple[str, str]]:
        """What should outlive the master."""
        return list(self._names.items())

    def bring_back(self, kept: Iterable[tuple[str, str]]) -> None:
        """Know the browsers of an earlier run."""
        for digest, name in kept:
            self._names[digest] = name
            self._drop_one(name)

    def _drop_one(self, name: str) -> None:
        """Make room, if there are too many."""
        counts = Counter(self._names.values())
        if counts[name] <= MOST_OF_ONE and len(self._names) <= MOST_KNOWN:
            return
        greedy = name if counts[name] > MOST_OF_ONE else counts.most_common(1)[0][0]
        del self._names[next(digest for digest, one in self._names.items() if one == greedy)]
