"""The doctor: what keeps a robot from working, on its computer, its buses and in itself; and what mends it.

Facts in, findings out: `gather` looks at the computer, `checks` judges what was seen and is pure.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from msbot.runtime.lazy_face import lazy_face

if TYPE_CHECKING:
    from msbot.doctor.examination import CHECKS, Check, Examination, examine
    from msbot.doctor.finding import Finding, Mending, NotSeen
    from msbot.doctor.patient import Patient

_NAMES = {
    "msbot.doctor.examination": ("CHECKS", "Check", "Examination", "examine"),
    "msbot.doctor.finding": ("Finding", "Mending", "NotSeen"),
    "msbot.doctor.patient": ("Patient",),
}

__getattr__ = lazy_face(__name__, _NAMES)

__all__ = ["CHECKS", "Check", "Examination", "Finding", "Mending", "NotSeen", "Patient", "examine"]
