"""The words of the pages in several languages: a catalogue that anybody can extend by a file.

The key of a text is the English text itself, so English needs no catalogue, and what is not translated yet shows in
English. Each other language is a gettext PO file in `languages`, as translators' tools read it (`tools/catalogue.py`
begins it); nothing else knows which languages there are. What the robot says (`msbot_agent.text.sentence`) is looked up
by its form, with the names of its values in braces; what a library says of its parts, by the text.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import field
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from string import Formatter
from typing import Any
from unicodedata import lookup

from starlette.requests import HTTPConnection

from msbot_agent.startup.bytecode_cache import cached_definitions
from msbot_agent.text.sentence import Sentence, said
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

COOKIE = "msbot_language"
ENGLISH = "en"
LONGEST_NUMBER = 40
_POINT, _COMMA = ord("."), ord(",")
"""Characters of a number that somebody types."""
_WHOLE = re.compile(r"[+-]?[0-9]+")
_GROUPED = re.compile(r"[+-]?[1-9][0-9]{0,2}\.[0-9]{3}")
"""Whose sign may be one for decimals, or one between thousands."""
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")


@dataclass(frozen=True, slots=True)
class Language:
    """One language of the pages."""

    code: str
    """As in RFC 5646: `en`, `de`."""
    name: str
    """Its own name for itself: `English`, `Deutsch`."""
    texts: Mapping[str, str] = field(default_factory=dict)
    """English text -> text in this language."""
    decimal: str = "."
    """The decimal separator of a number."""
    thousands: str = ","
    """What stands between groups of three digits."""

    def translate(self, text: str, /, **values: object) -> str:
        """The text in this language; `{name}` is replaced by the value of that name.

        A `Sentence` brings its own values, which are also put into this language.
        """
        if isinstance(text, Sentence):
            return self._put_in(self.texts.get(text.form, text.form), text.values)
        return self._put_in(self.texts.get(text, text), values)

    def count(self, number: int, one: str, many: str, /, **values: object) -> str:
        """A text about a number of things: `one` for a single one, else `many`; both may hold `{count}`."""
        return self.translate(one if number == 1 else many, count=number, **values)

    def number(self, value: float, form: str = "") -> str:
        """A number as it is written here, with `form` as in `format`: 49,9 for 49.9 in German."""
        return self.digits(format(value, form))

    def digits(self, text: str) -> str:
        """A number that is written the English way, as it is written here."""
        if self.decimal == "." and self.thousands == ",":
            return text
        return text.translate({_POINT: self.decimal, _COMMA: self.thousands})

    def read_number(self, text: str, *, is_whole: bool = False) -> float:
        """A number that a person has typed, with a comma or a point, whatever is usual here.

        Digits are grouped only by blanks, where this language does so.

        Where this language groups digits by the comma, `1,000` may be a thousand or, from who is used to a decimal
        comma, 1: nobody can know, so it is asked for. `0,125` and `1,5` are clear, and so is the language's own sign.

        Raises:
            ConfigError: it is none, or not a whole one, or may be one or another.
        """
        plain = text.strip().replace("\N{MINUS SIGN}", "-")
        if self.thousands.isspace():  # any blank between digits, as people type it
            plain = re.sub(r"(?<=[0-9])\s(?=[0-9]{3}(?![0-9]))", "", plain)
        plain = plain.replace(",", ".")
        if len(plain) <= LONGEST_NUMBER and _WHOLE.fullmatch(plain):
            return int(plain)
        if len(plain) <= LONGEST_NUMBER and _GROUPED.fullmatch(plain) and self.thousands in text:
            raise ConfigError(
                said(
                    "{text!r} may be {large} or {small}: write it in one of these ways",
                    text=text.strip(),
                    large=plain.replace(".", ""),
                    small=self.digits(str(float(plain))),
                )
            )
        number = float(plain) if len(plain) <= LONGEST_NUMBER and _NUMBER.fullmatch(plain) else math.nan
        if not math.isfinite(number):
            raise ConfigError(
                said(
                    "{text!r} is not a number: write 12 or {example}",
                    text=text[:LONGEST_NUMBER],
                    example=self.number(0.1),
                )
            )
        if is_whole and not number.is_integer():
            raise ConfigError(said("{number} is not a whole number", number=self.number(number)))
        return int(number) if is_whole else number

    def _put_in(self, form: str, values: Mapping[str, object]) -> str:
        return _Formatter(self).vformat(form, (), values) if values else form


class _Formatter(Formatter):
    """Puts values into a text: numbers with the language's signs, sentences in the language."""

    def __init__(self, language: Language) -> None:
        self._language = language

    def format_field(self, value: Any, format_spec: str) -> Any:  # noqa: ANN401 - as the class it extends
        """A value in this language."""
        if isinstance(value, Sentence):
            return format(self._language.translate(value), format_spec)
        words = format(value, format_spec)
        return self._language.digits(words) if isinstance(value, float) or "," in format_spec else words


PLAIN = Language(ENGLISH, "English")
"""English: what there is without a catalogue."""


@cache
def languages() -> Mapping[str, Language]:
    """All languages by code, English first."""
    found = [entry for entry in (files("msbot_web") / "languages").iterdir() if entry.name.endswith(".po")]
    others = [read_catalogue(entry) for entry in sorted(found, key=lambda entry: entry.name)]
    return {ENGLISH: PLAIN, **{language.code: language for language in others}}


def read_catalogue(entry: Traversable) -> Language:
    """A language of its PO file.

    Raises:
        OSError: the file cannot be read, or is no PO file.
        KeyError: its head does not say what the language is called, or how it writes numbers.
    """
    if isinstance(entry, Path):
        kept = cached_definitions(entry, _po_to_python, "PO 1")
        about, texts = kept["about"], kept["texts"]
    else:  # in an archive
        about, texts = _read_po(entry.read_text("utf-8"))
    name, decimal, thousands = about["X-Language-Name"], about["X-Decimal"], about["X-Thousands"]
    if len(thousands) > 1:  # by its Unicode name: a blank would get lost at the end of the file's line
        thousands = lookup(thousands)
    return Language(entry.name.removesuffix(".po"), name, texts, decimal, thousands)


def _po_to_python(octets: bytes) -> str:
    about, texts = _read_po(octets.decode())
    return f"about = {about!r}\ntexts = {texts!r}"


def _read_po(text: str) -> tuple[dict[str, str], dict[str, str]]:
    import polib  # what was read is kept, so most starts do without it

    catalogue = polib.pofile(text)
    return dict(catalogue.metadata), {entry.msgid: entry.msgstr for entry in catalogue.translated_entries()}


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
