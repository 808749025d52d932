"""The doctor: what keeps a robot from working, on its computer, its buses and in itself; and what mends it.

Facts in, findings out: `gather` looks at the computer, `checks` judges what was seen and is pure.
"""

from msbot.doctor.examination import CHECKS, Check, Examination, examine
from msbot.doctor.finding import Finding, Mending, NotSeen
from msbot.doctor.patient import Patient

__all__ = ["CHECKS", "Check", "Examination", "Finding", "Mending", "NotSeen", "Patient", "examine"]
