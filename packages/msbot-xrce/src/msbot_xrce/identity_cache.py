"""Results cached by the identity of an object."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

Given = TypeVar("Given")
Result = TypeVar("Result")


class IdentityCache(Generic[Given, Result]):
    """A function of one argument that never changes, whose latest results are kept by which object the argument is.

    For arguments that come again as the same object, where to hash all they consist of would cost as much as the result
    is worth.

    Args:
        function: what is called for an object that is not known.
        most: results kept; beyond, all are forgotten.
    """

    __slots__ = ("_function", "_most", "kept")

    def __init__(self, function: Callable[[Given], Result], most: int) -> None:
        self._function = function
        self.kept: dict[int, tuple[Given, Result]] = {}
        """What is known, by `id` of the object; for those who want to look without a call."""
        self._most = most

    def __call__(self, given: Given) -> Result:
        """The function's result; what it raises is not kept."""
        kept = self.kept.get(id(given))
        if kept is not None:
            return kept[1]
        result = self._function(given)
        if len(self.kept) >= self._most:
            self.kept.clear()
        self.kept[id(given)] = (given, result)  # the object is kept as well: so nothing else can have its id
        return result
