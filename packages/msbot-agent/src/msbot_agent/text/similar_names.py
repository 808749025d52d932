"""What somebody may have meant by a name that there is not."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches

from msbot_agent.text.sentence import joined, said

MOST_COMPARED = 200
LONGEST_COMPARED = 40
"""Most known words, and most characters of each, that are compared with a wrong one."""


def nearest(word: str, known: Iterable[str], limit: int = 3) -> list[str]:
    """The known words most similar to `word`, best first; case does not matter."""
    if len(word) > LONGEST_COMPARED:
        return []
    by_folded: dict[str, list[str]] = {}
    for candidate in known:
        if len(candidate) <= LONGEST_COMPARED:
            by_folded.setdefault(candidate.casefold(), []).append(candidate)
    wanted = word.casefold()
    candidates = list(by_folded)
    if len(candidates) > MOST_COMPARED:
        alike = [one for one in candidates if one[:1] == wanted[:1] and abs(len(one) - len(wanted)) <= 2]
        candidates = alike[:MOST_COMPARED]
    folded = get_close_matches(wanted, candidates, n=limit, cutoff=0.6)
    return [candidate for key in folded for candidate in by_folded[key]][:limit]


def did_you_mean(near: Sequence[str]) -> str:
    """The question about one or several similar words."""
    return said("did you mean {words}?", words=joined(said(" or "), near))


def instead_of(name: str, known: Iterable[str]) -> str:
    """What to write instead of a name that there is not: the most similar ones, else all that there are."""
    there = list(known)
    if near := nearest(name, there):
        return did_you_mean(near)
    return said("there are {known}", known=", ".join(there) or said("none"))
