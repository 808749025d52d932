"""Numbers of things in what a command prints: one is one."""

from __future__ import annotations


def amount(count: int, one: str, many: str = "") -> str:
    """A number with its noun, `1 file`, `2 files`; `many` where it is not `one` with an s.

    For sentences that are translated, see `msbot_agent.text.sentence.counted`.
    """
    return f"{count} {one if count == 1 else many or f'{one}s'}"
