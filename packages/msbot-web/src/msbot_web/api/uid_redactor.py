"""Octets that only teachers see: a frame with a piece of a part's UID is shown without its data.

In a robot without keys a UID is all that a part shows, so whoever reads one can pretend to be that part. Frames of a
CAN bus carry it in pieces: three octets in a row are enough to know one by.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from msbot_agent.text.sentence import changed
from msbot_web.models.bus_models import FrameLine

HIDDEN = "…"
_UID = re.compile(r"(?<![0-9A-Za-z])[0-9A-Fa-f]{16}(?![0-9A-Za-z])")
_OCTETS = re.compile(r"[0-9A-Fa-f]+(?:[ .:-][0-9A-Fa-f]+)*")
_DIGITS = 6
"""Of a piece: three octets."""


def without_uids(text: str) -> str:
    """The text without UIDs, in whatever sentence they stand."""
    return changed(text, lambda plain: _UID.sub(HIDDEN, plain))


class UidRedactor:
    """Knows the pieces of UIDs.

    Args:
        uids: in hexadecimal digits; empty ones are none.
    """

    def __init__(self, uids: Iterable[str]) -> None:
        self._pieces = {
            piece
            for uid in uids
            for at in range(0, len(uid) - _DIGITS + 1, 2)
            if len(set(bytes.fromhex(piece := uid[at : at + _DIGITS].lower()))) > 1  # zeros are in every frame
        }

    def are_in(self, text: str) -> bool:
        """Whether a text in hexadecimal digits holds a piece of a UID."""
        if not self._pieces:
            return False
        for run in _OCTETS.findall(text):
            digits = re.sub("[ .:-]", "", run).lower()
            if any(digits[at : at + _DIGITS] in self._pieces for at in range(len(digits) - _DIGITS + 1)):
                return True
        return False

    def lines(self, text: str) -> str:
        """A table of frames without the lines that hold one."""
        return "".join(
            line for line in text.splitlines(keepends=True) if not self.are_in(line) and not _UID.search(line)
        )

    def frames(self, rows: Sequence[FrameLine]) -> list[FrameLine]:
        """Frames, with nothing but the identifier of those that hold one."""
        return [self._frame(row) if self.are_in(row.notation) else self._words(row) for row in rows]

    @staticmethod
    def _frame(row: FrameLine) -> FrameLine:
        identifier = row.text.strip().partition("  ")[0]
        hidden = row.model_copy(update={"text": f"{identifier}  {HIDDEN}", "notation": "", "words": []})
        return UidRedactor._words(hidden)

    @staticmethod
    def _words(row: FrameLine) -> FrameLine:
        texts = {name: [without_uids(text) for text in getattr(row, name)] for name in ("plain", "about", "words")}
        return row.model_copy(update=texts)
