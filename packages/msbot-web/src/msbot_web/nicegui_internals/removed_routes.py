"""What FastAPI keeps of routes that were removed.

NiceGUI gives each upload a route of its own, whose function holds the element, and so its whole page. The route goes
with the page, but FastAPI keeps what it has found out of the last thousands of functions, and with it the functions.
"""

from __future__ import annotations

from functools import _lru_cache_wrapper

from fastapi.dependencies import models

_KEPT = [one for one in vars(models).values() if isinstance(one, _lru_cache_wrapper)]


def forget_functions() -> None:
    """Let go of the functions of removed routes; those that are still there are looked at again when needed."""
    for one in _KEPT:
        one.cache_clear()
