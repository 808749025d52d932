"""Sentences that can be translated: a text in English that remembers its form and its values.

Every room explains itself in English and passes on a plain text. A reader in another language (the pages) looks up the
form in a catalogue and puts the same values into it, so no translation ever has to parse English.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Final

JsonSentence = str | dict[str, object]
"""A text, or a sentence as `to_json` writes it."""

_FORM: Final = "form"
_VALUES: Final = "values"


class Sentence(str):
    """A text that knows how it was made.

    Attributes:
        form: the sentence with names in braces, in English: `heard again after {silence:.1f} s`.
        values: the value of each name; a value may itself be a sentence.
    """

    __slots__ = ("form", "values")

    form: str
    values: Mapping[str, object]

    def __new__(cls, form: str, values: Mapping[str, object]) -> Sentence:
        """The sentence with its values put in."""
        made = super().__new__(cls, form.format(**values) if values else form)
        made.form, made.values = form, values
        return made

    def __str__(self) -> str:
        """Itself, so that the text of an error made from a sentence is still a sentence."""
        return self

    def __reduce__(self) -> tuple[type[Sentence], tuple[str, Mapping[str, object]]]:
        """Make it survive pickling, so that it can come from another process."""
        return Sentence, (self.form, self.values)


def said(form: str, /, **values: object) -> Sentence:
    """A sentence of that form; `{name}` stands for the value of that name, as in `str.format`."""
    return Sentence(form, values)


def counted(count: int, one: str, many: str, /, **values: object) -> Sentence:
    """A sentence about a number of things: `one` for a single thing, else `many`; both may hold `{count}`."""
    return Sentence(one if count == 1 else many, {"count": count, **values})


def joined(joint: str, texts: Iterable[str]) -> str:
    """Texts one after the other with a joint between them; each may be a sentence, and so may the joint."""
    values: dict[str, object] = {f"text{number}": text for number, text in enumerate(texts)}
    form = "{joint}".join(f"{{{name}}}" for name in values)
    return Sentence(form, {**values, "joint": joint}) if values else ""


def without(text: str, names: Collection[str], instead: str) -> str:
    """The text with `instead` in place of the values of these names, wherever they occur."""
    if not isinstance(text, Sentence):
        return text
    values = {
        name: instead if name in names else without(value, names, instead) if isinstance(value, str) else value
        for name, value in text.values.items()
    }
    return Sentence(text.form, values)


def changed(text: str, change: Callable[[str], str]) -> str:
    """The text with `change` made to every plain text in it."""
    if not isinstance(text, Sentence):
        return change(text)
    values = {name: changed(value, change) if isinstance(value, str) else value for name, value in text.values.items()}
    return Sentence(text.form, values)


def to_json(text: str) -> JsonSentence:
    """A text as a database stores it: values that JSON cannot hold become texts."""
    if not isinstance(text, Sentence):
        return text
    values = {
        name: to_json(value) if isinstance(value, str) else value if isinstance(value, int | float) else str(value)
        for name, value in text.values.items()
    }
    return {_FORM: text.form, _VALUES: values}


def from_json(content: object) -> str:
    """The text that `to_json` wrote; since it may come from a file, anything malformed is shown as it is."""
    match content:
        case str():
            return content
        case {"form": str(form), "values": dict(values)}:
            texts = {
                str(name): from_json(value) if isinstance(value, str | dict) else value
                for name, value in values.items()
            }
            try:
                return Sentence(form, texts)
            except (KeyError, IndexError, ValueError, AttributeError):
                return form
    return str(content)


# Words of others, fit for a terminal.


def printable(text: str) -> str:
    """The text with `?` for each character that would control a terminal, line breaks included."""
    return text if text.isprintable() else "".join(one if one.isprintable() else "?" for one in text)


def whole(text: str) -> str:
    """The text with `?` for each half of a character, which UTF-8 cannot write, and so no file and no database.

    They come from command lines that are no UTF-8, and from JSON such as `"\\ud800"`.
    """
    try:
        text.encode()
    except UnicodeEncodeError:
        return text.encode("utf-8", "replace").decode()
    return text


# A stranger's text as the cell of a table that somebody opens in a spreadsheet.


_OWN_NAME = re.compile(r"@[A-Za-z][\w.]*")
"""A figure of the robot, as `@late`: without parentheses no spreadsheet calls anything."""


def as_cell(text: str) -> str:
    """The text; with `'` before it where a spreadsheet would take it for a formula and do what it says."""
    if text[:1] not in tuple("=+-@\t\r\n") or _OWN_NAME.fullmatch(text):
        return text
    try:
        float(text)
    except ValueError:
        return f"'{text}"
    return text
