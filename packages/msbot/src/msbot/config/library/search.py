"""Full-text search in the part library: every word must be found; the best place where it is found decides the order.

A plain index of words: it is built in milliseconds, needs no database, and finds beginnings of words and near misses.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Iterable, Iterator

from msbot.config.library.part_types import PartType
from msbot_agent.text.similar_names import nearest

_WORD = re.compile(r"[^\W_]+")
_WHOLE, _BEGINNING, _NEAR = 4.0, 2.0, 1.0
"""The weight of a word found whole, as a beginning, or approximately."""
_SHORTEST_NEAR = 4
"""A shorter word is never matched approximately."""


class PartSearch:
    """An index over part types."""

    def __init__(self, types: Iterable[PartType]) -> None:
        self._types = list(types)
        self._weights: dict[str, dict[int, float]] = {}
        for position, part_type in enumerate(self._types):
            for text, weight in _texts(part_type):
                for word in words_of(text):
                    found = self._weights.setdefault(word, {})
                    found[position] = max(found.get(position, 0.0), weight)
        self._words = sorted(self._weights)

    def find(self, query: str, limit: int = 20) -> list[PartType]:
        """The part types in which every word of the query is found, the best first."""
        scores: dict[int, float] | None = None
        for word in dict.fromkeys(words_of(query)):
            found = self._look_up(word)
            scores = found if scores is None else {at: scores[at] + found[at] for at in scores.keys() & found.keys()}
        ordered = sorted((scores or {}).items(), key=lambda item: (-item[1], self._types[item[0]].number))
        return [self._types[position] for position, _ in ordered[:limit]]

    def _look_up(self, word: str) -> dict[int, float]:
        """Where one word is found and how well."""
        found: dict[int, float] = {}
        for known in self._beginning_with(word):
            _keep_best(found, self._weights[known], _WHOLE if known == word else _BEGINNING)
        if not found and len(word) >= _SHORTEST_NEAR:
            for known in nearest(word, self._words):
                _keep_best(found, self._weights[known], _NEAR)
        return found

    def _beginning_with(self, word: str) -> Iterator[str]:
        at = bisect_left(self._words, word)
        while at < len(self._words) and self._words[at].startswith(word):
            yield self._words[at]
            at += 1


def words_of(text: str) -> list[str]:
    """The words of a text as the index has them: letters and digits, in lower case."""
    return [word.casefold() for word in _WORD.findall(text)]


def _texts(part_type: PartType) -> Iterator[tuple[str, float]]:
    """Every text by which a part type is found, with its weight."""
    yield part_type.number, 4.0
    yield part_type.number.replace("-", ""), 4.0
    yield part_type.name, 3.0
    for keyword in part_type.keywords:
        yield keyword, 3.0
    yield part_type.category.value, 2.0
    for port in part_type.ports:
        yield f"{port.name} {port.type_name}", 2.0
        yield port.description, 1.0
    for parameter in part_type.parameters:
        yield f"{parameter.name} {parameter.description}", 1.0
    yield f"{part_type.description} {part_type.manufacturer} {part_type.specification}", 1.5
    yield f"{part_type.connector} {' '.join(pin.name for pin in part_type.pins)}", 0.5


def _keep_best(found: dict[int, float], weights: dict[int, float], factor: float) -> None:
    for position, weight in weights.items():
        found[position] = max(found.get(position, 0.0), weight * factor)
