"""The doctor: finds what keeps a robot from working.

Facts in, findings out: `gather` looks at the computer, `checks` judges what was seen and is pure.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from msbot_xrce.lazy import lazy_face

if TYPE_CHECKING:
    from msbot.doctor.examination import CHECKS, Check, Examination, all_checks, examine
    from msbot.doctor.finding import CannotSee, Examined, Finding, Mending, NotNeeded, Unavailable

_NAMES = {
    "msbot.doctor.examination": (
        "CHECKS",
        "Check",
        "Examination",
        "all_checks",
        "examine",
    ),
    "msbot.doctor.finding": (
        "CannotSee",
        "Finding",
        "Mending",
        "NotNeeded",
        "Unavailable",
        "Examined",
    ),
}

__getattr__ = lazy_face(__name__, _NAMES)

__all__ = [
    "CHECKS",
    "CannotSee",
    "Check",
    "Examination",
    "Examined",
    "Finding",
    "Mending",
    "NotNeeded",
    "Unavailable",
    "all_checks",
    "examine",
]
