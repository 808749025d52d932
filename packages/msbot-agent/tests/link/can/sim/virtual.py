"""Coroutines as tests, in virtual time."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from functools import wraps
from typing import ParamSpec

from msbot.process.virtual_time import run_virtual

P = ParamSpec("P")


def virtually(test: Callable[P, Coroutine[object, object, None]]) -> Callable[P, None]:
    """Run it on a loop whose clock begins at 0 and jumps."""

    @wraps(test)
    def run(*arguments: P.args, **named: P.kwargs) -> None:
        run_virtual(test(*arguments, **named))

    return run
