"""For what must be gone through to its end: a step that fails is logged, and the next one is taken."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import ParamSpec

_P = ParamSpec("_P")
_log = logging.getLogger(__name__)


def in_any_case(step: Callable[_P, object], *arguments: _P.args, **named: _P.kwargs) -> None:
    """Take a step of which no failure may keep the caller from its next one; the log has the failure."""
    try:
        step(*arguments, **named)
    except Exception:
        _log.exception("this failed, and what comes after it is done all the same")
