"""Answers in the forms in which people write them: `ten`, `10 slots`, `6 s`, `6 seconds`, `6,0`. Pure."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

LONGEST: Final = 200
"""Characters of an answer that are looked at."""
_SMALL: Final = (
    ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve",
     "thirteen", "fourteen", "fifteen", "sixteen", "seventeen", "eighteen", "nineteen"),
    ("null", "eins", "zwei", "drei", "vier", "fünf", "sechs", "sieben", "acht", "neun", "zehn", "elf", "zwölf",
     "dreizehn", "vierzehn", "fünfzehn", "sechzehn", "siebzehn", "achtzehn", "neunzehn"),
)  # fmt: skip
_TENS: Final = (
    ("twenty", "thirty", "forty", "fifty", "sixty", "seventy", "eighty", "ninety"),
    ("zwanzig", "dreißig", "vierzig", "fünfzig", "sechzig", "siebzig", "achtzig", "neunzig"),
)
_UNITS: Final = (
    ("s", "sec", "secs", "second", "seconds", "sek", "sekunde", "sekunden"),
    ("ms", "millisecond", "milliseconds", "millisekunde", "millisekunden"),
    ("min", "mins", "minute", "minutes", "minuten"),
    ("h", "hour", "hours", "stunde", "stunden"),
    ("%", "percent", "per cent", "prozent"),
    ("°", "deg", "degree", "degrees", "grad"),
    ("°/s", "degrees a second", "degrees per second", "degree a second", "degree per second", "grad pro sekunde"),
    ("m", "metre", "metres", "meter", "meters", "metern"),
    ("cm", "centimetre", "centimetres", "centimeter", "centimeters"),
    ("mm", "millimetre", "millimetres", "millimeter", "millimeters"),
    ("bit/s", "bits/s", "bits a second", "bits per second", "bit pro sekunde", "bits pro sekunde"),
    ("kbit/s", "kbits/s", "kilobits a second", "kilobits per second", "kilobit pro sekunde"),
    ("octets", "octet", "bytes", "byte", "oktette", "oktett"),
)
"""Each line is one unit in all its spellings."""
_ABOUT: Final = re.compile(r"^(?:=|it is|it's|es sind|es ist)\s*")
_NUMBER: Final = re.compile(r"(?P<number>[+-]?(?:\d+(?:[.,]\d+)?|[.,]\d+))(?P<rest>(?![\d.,]).*)")
_THOUSANDS: Final = re.compile(r"(?P<number>[+-]?\d{1,3}(?:[., ]\d{3})+)(?P<rest>(?![\d.,]).*)")
_WORDS: Final = re.compile(r"(?P<number>[a-zäöü]+(?:[- ][a-z]+)?)\b(?P<rest>.*)")
_WORD: Final = re.compile(r"[^\d,;:/?!]{1,40}")
_NOT: Final = re.compile(r"\b(?:or|oder|and|und|not|nicht|to|bis)\b")
"""Whoever writes one of these after a number has not decided."""
_MARKS: Final = re.compile(r"[.,;:!?\"'“”„‚‘’()]+(?=\s|$)|(?<=\s)[\"'“”„‚‘’()]+|^[\"'“”„‚‘’()]+")
_LITTLE: Final = frozenset({"the", "a", "an", "and", "der", "die", "das", "ein", "eine", "und"})


def is_same(right: str, given: str, *, tolerance: float = 0.0, unit: str = "") -> bool:
    """Whether an answer is the right one, in whatever form it is written."""
    if len(given) > LONGEST:
        return False
    if _without_articles(right) == _without_articles(given):
        return True
    found = _NUMBER.fullmatch(_plain(right))
    if found is None or "," in found["number"]:
        return False
    wanted, own_unit = float(found["number"]), found["rest"].strip()
    return any(
        abs(wanted - value) <= tolerance + 1e-12
        and (_is_unit(rest, own_unit) if own_unit else _may_follow(rest, _plain(unit)))
        for value, rest in _readings(_plain(given))
    )


def _may_follow(rest: str, unit: str) -> bool:
    """Whether these words may stand behind a number in that unit; empty: in any."""
    if not rest or (unit and _is_unit(rest, unit)):
        return True
    return not unit and _WORD.fullmatch(rest) is not None and _NOT.search(rest) is None


def _is_unit(words: str, unit: str) -> bool:
    kind = _kind(words)
    return words == unit or (kind is not None and kind == _kind(unit))


def _kind(unit: str) -> int | None:
    return next((place for place, spellings in enumerate(_UNITS) if unit in spellings), None)


def _readings(text: str) -> list[tuple[float, str]]:
    """The numbers that a text may begin with, in digits or in words, each with what follows it."""
    text = _ABOUT.sub("", text)
    found: list[tuple[float, str]] = []
    if digits := _NUMBER.fullmatch(text):
        found.append((float(digits["number"].replace(",", ".")), digits["rest"].strip()))
    if digits := _THOUSANDS.fullmatch(text):
        found.append((float(re.sub("[., ]", "", digits["number"])), digits["rest"].strip()))
    if words := _WORDS.fullmatch(text):
        name, rest = words["number"].replace("-", " "), words["rest"].strip()
        first, _, second = name.partition(" ")
        if name in _NUMBERS:
            found.append((float(_NUMBERS[name]), rest))
        elif first in _NUMBERS:
            found.append((float(_NUMBERS[first]), f"{second} {rest}".strip()))
    return found


def _plain(text: str) -> str:
    """Without capitals, punctuation, and blanks that are too many."""
    return " ".join(_MARKS.sub(" ", text.casefold()).split())


def _without_articles(text: str) -> str:
    words = _plain(text).split()
    return " ".join([word for word in words if word not in _LITTLE] or words)


def _numbers() -> Mapping[str, int]:
    english, german = _SMALL
    found = {word.casefold(): number for words in _SMALL for number, word in enumerate(words)}
    found["ein"] = found["eine"] = 1
    for place, (ten, zehn) in enumerate(zip(*_TENS, strict=True)):
        found[ten] = found[zehn.casefold()] = tens = 20 + 10 * place
        for one in range(1, 10):
            found[f"{ten} {english[one]}"] = tens + one
            word = "ein" if one == 1 else german[one]
            found[f"{word}und{zehn}".casefold()] = tens + one
    return found | {"hundred": 100, "one hundred": 100, "hundert": 100, "einhundert": 100}


_NUMBERS: Final = _numbers()
