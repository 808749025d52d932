"""One table of a TOML file, read key by key; every mistake becomes a problem and reading goes on.

A method returns the value when it is right; otherwise it notes a problem and returns a harmless value of the same
type, which nobody sees because the problems are raised at the end. `finish` notes every key that was not read.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence

from msbot_agent.text.sentence import said
from msbot_agent.toml.document import Document
from msbot_agent.toml.problems import (
    FileLocation,
    KeyPath,
    Problems,
    path_words,
    quoted,
    suggestion,
    toml_value_in_words,
)

MOST_OCTETS = 254
"""Longest text in octets of UTF-8: the thesis stores every string in 255 characters, including the closing NUL
(3.12)."""

MOST_PROSE = 2000
"""Longest text that is only read by people, in characters."""

Scalar = bool | int | float | str
"""What a setting, a default or a safe value can be."""


class Table:
    """A table and its place in the document (see the module's docstring)."""

    def __init__(
        self,
        document: Document,
        problems: Problems,
        values: Mapping[str, object] | None,
        path: KeyPath = (),
    ) -> None:
        self.path = path
        self.is_there = values is not None
        """Whether the file has this table at all."""
        self._document = document
        self._problems = problems
        self._values = {} if values is None else values
        self._asked: list[str] = []

    def __contains__(self, key: str) -> bool:
        self._asked.append(key)
        return key in self._values

    def location(self, *steps: str | int) -> FileLocation:
        """Where a key of this table is, or should be; without steps: the table itself."""
        return self._document.location((*self.path, *steps))

    def report(self, sentence: str, *steps: str | int) -> None:
        """Note one mistake about a key of this table, or about the table itself."""
        self._problems.add(self.location(*steps), sentence)

    def name(self, key: str, example: str, *, default: str | None = None, forbidden: str = "") -> str:
        """A text of 1 to 254 octets on one line, without blanks at its ends.

        Args:
            key: the key to read.
            example: a right value, shown when it is missing or of another type.
            default: the value when the key is absent; None: the key is required.
            forbidden: characters it must not contain.
        """
        value = self._text(key, example, default)
        if value is None or (value == default and key not in self):
            return value or ""
        if not value.strip():
            self.report(said('must not be empty; write for example {key} = "{example}"', key=key, example=example), key)
        elif value != value.strip():
            self.report(
                said(
                    '"{value}" has blanks at its ends; write {key} = "{right}"',
                    value=value,
                    key=key,
                    right=value.strip(),
                ),
                key,
            )
        else:
            self._check_characters(key, value, forbidden)
        return value

    def text(self, key: str, example: str, *, default: str = "") -> str:
        """Any text of up to 254 octets; may be empty or absent."""
        value = self._text(key, example, default) or ""
        self._check_length(key, value)
        return value

    def prose(self, key: str, example: str, *, default: str | None = None, most: int = MOST_PROSE) -> str:
        """A text for people to read, also of several lines, of 1 to `most` characters; `default` when it is absent."""
        value = self._text(key, example, default)
        if value is None or (value == default and key not in self):
            return value or ""
        self._check_prose(value, most, key)
        return value.strip()

    def proses(self, key: str, example: str, *, most: int = MOST_PROSE) -> list[str]:
        """A list of such texts; empty when absent."""
        value = self._get(key)
        if value is None:
            return []
        texts = value if isinstance(value, list) else [None]
        for position, text in enumerate(texts):
            if isinstance(text, str):
                self._check_prose(text, most, key, position)
        if not all(isinstance(text, str) for text in texts):
            self.report(
                said('must be a list of texts, for example {key} = ["{example}"]', key=key, example=example), key
            )
        return [text.strip() for text in texts if isinstance(text, str)]

    def choice(self, key: str, choices: Sequence[str], *, default: str | None = None) -> str:
        """One of a few words."""
        value = self._text(key, choices[0], default)
        if value is None:
            return choices[0]
        if value not in choices:
            self.report(
                said(
                    '"{value}" is none of {words}; {right}',
                    value=value,
                    words=quoted(choices),
                    right=suggestion(value, choices, none_known=""),
                ),
                key,
            )
            return choices[0]
        return value

    def number(
        self, key: str, *, default: float, least: float, most: float, unit: str = "", above: bool = False
    ) -> float:
        """A finite number from `least` to `most`; with `above` it must be more than `least`."""
        value = self._get(key)
        if value is None:
            return default
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.report(
                said(
                    "must be a number, for example {key} = {default:g}; it is {kind}",
                    key=key,
                    default=default,
                    kind=toml_value_in_words(value),
                ),
                key,
            )
            return default
        in_range = math.isfinite(value) and (least < value if above else least <= value) and value <= most
        if not in_range:
            low = said("more than {least:g}", least=least) if above else f"{least:g}"
            of_unit = f" {unit}" if unit else ""
            self.report(
                said(
                    "is {value}; it must be {low} to {most:g}{of_unit}",
                    value=value,
                    low=low,
                    most=most,
                    of_unit=of_unit,
                ),
                key,
            )
            return default
        return float(value)

    def whole(self, key: str, *, default: int, least: int, most: int) -> int:
        """A whole number from `least` to `most`."""
        value = self._get(key)
        if value is None:
            return default
        if isinstance(value, bool) or not isinstance(value, int):
            self.report(
                said(
                    "must be a whole number, for example {key} = {default}; it is {kind}",
                    key=key,
                    default=default,
                    kind=toml_value_in_words(value),
                ),
                key,
            )
            return default
        if not least <= value <= most:
            self.report(said("is {value}; it must be {least} to {most}", value=value, least=least, most=most), key)
            return default
        return value

    def wholes(self, key: str, *, least: int, most: int) -> list[int]:
        """A list of whole numbers from `least` to `most`; empty when absent."""
        value = self._get(key)
        if value is None:
            return []
        if not isinstance(value, list):
            self.report(
                said(
                    "must be a list, for example {key} = [{least}]; it is {kind}",
                    key=key,
                    least=least,
                    kind=toml_value_in_words(value),
                ),
                key,
            )
            return []
        for position, item in enumerate(value):
            if isinstance(item, bool) or not isinstance(item, int):
                self.report(said("must be a whole number; it is {kind}", kind=toml_value_in_words(item)), key, position)
            elif not least <= item <= most:
                self.report(
                    said("is {item}; it must be {least} to {most}", item=item, least=least, most=most), key, position
                )
        return [item for item in value if isinstance(item, int)]

    def flag(self, key: str, *, default: bool) -> bool:
        """`true` or `false`."""
        value = self._get(key)
        if value is None or isinstance(value, bool):
            return default if value is None else value
        self.report(said("must be true or false, without quotes; it is {kind}", kind=toml_value_in_words(value)), key)
        return default

    def names(self, key: str, example: str, *, required: bool = False) -> list[str]:
        """A list of texts, each as `name` requires."""
        if required and key not in self:
            self._missing(key, f'["{example}"]')
        value = self._get(key)
        if value is None:
            return []
        if not isinstance(value, list):
            self.report(
                said(
                    'must be a list, for example {key} = ["{example}"]; it is {kind}',
                    key=key,
                    example=example,
                    kind=toml_value_in_words(value),
                ),
                key,
            )
            return []
        return [self._item(key, position, item, example) for position, item in enumerate(value)]

    def one_or_more(self, key: str, example: str) -> list[str]:
        """A text, or a list of texts, that must be there; an empty list after a problem."""
        value = self._get(key)
        if value is None:
            self._missing(key, f'"{example}"')
            return []
        if isinstance(value, list):
            return self.names(key, example)
        return [] if (word := self._text(key, example, None)) is None else [self._item(key, 0, word, example)]

    def scalar(self, key: str) -> Scalar | None:
        """A number, a truth value or a text; None when absent or of another kind."""
        value = self._get(key)
        if value is None or isinstance(value, bool | int | float | str):
            return value
        self.report(said("must be a number, true, false or a text; it is {kind}", kind=toml_value_in_words(value)), key)
        return None

    def scalars(self, key: str) -> dict[str, Scalar]:
        """A table of numbers, truth values and texts; empty when absent."""
        table = self.table(key)
        values = {name: table.scalar(name) for name in table.present_keys()}
        return {name: value for name, value in values.items() if value is not None}

    def item(self, key: str) -> object:
        """The value as the file has it, for forms that no other method knows; None when absent."""
        return self._get(key)

    def is_empty(self, key: str) -> bool:
        """Whether there is an empty list under `key`."""
        return self._values.get(key) == []

    def present_keys(self) -> list[str]:
        """The keys that are there."""
        return list(self._values)

    def table(self, key: str, *, required: bool = False) -> Table:
        """The table under `key`; an empty one when it is absent or something else."""
        if required and key not in self:
            self.report(
                said("is missing; add a table that begins with [{path}]", path=path_words((*self.path, key))), key
            )
        value = self._get(key)
        if value is not None and not isinstance(value, dict):
            self.report(
                said(
                    "must be a table that begins with [{key}]; it is {kind}", key=key, kind=toml_value_in_words(value)
                ),
                key,
            )
        values = value if isinstance(value, dict) else None
        return Table(self._document, self._problems, values, (*self.path, key))

    def tables(self, key: str) -> list[Table]:
        """The tables under `[[key]]`, in the order of the file."""
        value = self._get(key)
        if value is None:
            return []
        if not isinstance(value, list):
            self.report(
                said(
                    "must begin with two brackets, [[{key}]], once for each; it is {kind}",
                    key=key,
                    kind=toml_value_in_words(value),
                ),
                key,
            )
            return []
        found = []
        for position, item in enumerate(value):
            if isinstance(item, dict):
                found.append(Table(self._document, self._problems, item, (*self.path, key, position)))
            else:
                self.report(
                    said(
                        "must be a table that begins with [[{key}]]; it is {kind}",
                        key=key,
                        kind=toml_value_in_words(item),
                    ),
                    key,
                    position,
                )
        return found

    def finish(self) -> None:
        """Note every key that was not read, with the most similar one that exists."""
        for key in self._values:
            if key not in self._asked:
                right = suggestion(key, sorted(set(self._asked)), none_known=said("remove it"))
                self.report(said("there is no such key here; {right}", right=right), key)

    def _get(self, key: str) -> object:
        self._asked.append(key)
        return self._values.get(key)

    def _missing(self, key: str, example: str) -> None:
        self.report(said("is missing; add a line such as {key} = {example}", key=key, example=example), key)

    def _text(self, key: str, example: str, default: str | None) -> str | None:
        """The text, the default when absent; None after a problem."""
        value = self._get(key)
        if value is None:
            if default is None:
                self._missing(key, f'"{example}"')
            return default
        if not isinstance(value, str):
            self.report(
                said(
                    'must be text in quotes, for example {key} = "{example}"; it is {kind}',
                    key=key,
                    example=example,
                    kind=toml_value_in_words(value),
                ),
                key,
            )
            return None
        return value

    def _item(self, key: str, position: int, item: object, example: str) -> str:
        if isinstance(item, str) and item.strip():
            self._check_length(key, item, position)
            return item
        words = said("an empty text") if isinstance(item, str) else toml_value_in_words(item)
        self.report(
            said('must be text in quotes, for example "{example}"; it is {words}', example=example, words=words),
            key,
            position,
        )
        return ""

    def _check_prose(self, value: str, most: int, *steps: str | int) -> None:
        if not value.strip():
            self.report(said("is empty; write a sentence, or remove it"), *steps)
        elif len(value) > most:
            self.report(said("is {count} characters long; shorten it to {most}", count=len(value), most=most), *steps)
        elif not all(character.isprintable() or character == "\n" for character in value):
            self.report(said("contains a character that cannot be printed; remove it"), *steps)

    def _check_length(self, key: str, value: str, *steps: int) -> None:
        octets = len(value.encode())
        if octets > MOST_OCTETS:
            self.report(
                said(
                    '"{value}..." is {octets} bytes long; shorten it to {most_octets}',
                    value=value[:20],
                    octets=octets,
                    most_octets=MOST_OCTETS,
                ),
                key,
                *steps,
            )

    def _check_characters(self, key: str, value: str, forbidden: str) -> None:
        self._check_length(key, value)
        if not value.isprintable():
            self.report(said("{value!r} contains a character that cannot be printed; remove it", value=value), key)
        for character in forbidden:
            if character in value:
                self.report(
                    said(
                        '"{value}" must not contain "{character}"; use for example "_" in its place',
                        value=value,
                        character=character,
                    ),
                    key,
                )


# Keys and values as TOML writes them.


_BARE = re.compile(r"[A-Za-z0-9_-]+")


def toml_key(name: str) -> str:
    """A key, in quotes if it needs them."""
    return name if _BARE.fullmatch(name) else toml_value(name)


def toml_value(value: object) -> str:
    """A number, truth value or text, or a list or table of them on one line."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        # TOML understands what JSON escapes, but also needs DEL escaped.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007F")
    if isinstance(value, dict):
        return toml_table(value)
    if isinstance(value, list):
        return f"[{', '.join(map(toml_value, value))}]"
    return repr(value)


def toml_table(values: Mapping[str, object]) -> str:
    """A table on one line."""
    return f"{{ {', '.join(f'{toml_key(key)} = {toml_value(value)}' for key, value in values.items())} }}"
