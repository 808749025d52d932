"""The words of the pages in several languages: a catalogue that anybody can extend by one file.

The key of a text is the English text itself, so English needs no catalogue, and what is not translated yet shows in
English. `languages/de.toml` holds German; a new language is one more file there (code, name, and the texts).
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files

from starlette.requests import HTTPConnection

COOKIE = "msbot_language"
ENGLISH = "en"


@dataclass(frozen=True, slots=True)
class Language:
    """One language of the pages."""

    code: str
    """As in RFC 5646: `en`, `de`."""
    name: str
    """In its own words: `English`, `Deutsch`."""
    texts: Mapping[str, str] = field(default_factory=dict)
    """English text -> text in this language."""

    def say(self, text: str, **values: object) -> str:
        """The text in this language; `{name}` is replaced by the value of that name."""
        words = self.texts.get(text, text)
        return words.format(**values) if values else words


@cache
def languages() -> Mapping[str, Language]:
    """All languages by code, English first."""
    known = {ENGLISH: Language(ENGLISH, "English")}
    folder = files("msbot.web") / "languages"
    for entry in sorted(folder.iterdir(), key=lambda entry: entry.name):
        if entry.name.endswith(".toml"):
            content = tomllib.loads(entry.read_text("utf-8"))
            code = entry.name.removesuffix(".toml")
            known[code] = Language(code, content["name"], content["texts"])
    return known


def language_of(request: HTTPConnection) -> Language:
    """The language of a request: what the person has chosen, else what the browser prefers, else English."""
    chosen = request.cookies.get(COOKIE, "")
    if chosen in languages():
        return languages()[chosen]
    for wish in request.headers.get("accept-language", "").split(","):
        code = wish.split(";")[0].strip().partition("-")[0].casefold()
        if code in languages():
            return languages()[code]
    return languages()[ENGLISH]
