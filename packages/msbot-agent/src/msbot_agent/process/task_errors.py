"""One error in place of the group that a `TaskGroup` makes of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager


@contextmanager
def ungrouped(kind: type[Exception]) -> Iterator[None]:
    """Raise the first error of that kind by itself, when a group holds nothing but such errors.

    Not `except*`: up to Python 3.11.3, which Debian 12 and Raspberry Pi OS have, an error raised there comes out in a
    group again.

    Raises:
        Exception: of that kind; other groups come out as they are.
    """
    try:
        yield
    except BaseExceptionGroup as group:
        found, rest = group.split(kind)
        if found is None or rest is not None:
            raise
        raise _first(found) from None


def _first(group: BaseExceptionGroup[BaseException]) -> BaseException:
    leaves: Sequence[BaseException] = group.exceptions
    while isinstance(leaves[0], BaseExceptionGroup):
        leaves = leaves[0].exceptions
    return leaves[0]
