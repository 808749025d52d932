"""`fault list`, `lesson status`, `pupils list` print tables like all other commands: whole rows in a pipe."""

from __future__ import annotations

from typing import Any

import pytest
from click.testing import CliRunner

import msbot_school.cli.fault
import msbot_school.cli.lesson
import msbot_web.cli.user_commands
from msbot_agent.cli import msbot

FAULT = {
    "number": 3, "who": "ann", "words": "every third packet of fan is lost", "active": True, "since_s": 4.0,
    "left_s": 56.0, "begins_in_s": None, "when": "", "hidden": True,
}  # fmt: skip
FAULTS = {"faults": [FAULT, {"number": 4, "words": "a mission's fault", "concealed": True}]}
CHECKS = [
    {"check": "1.1", "ticked": ["bob"], "says": "fan is active"},
    {"check": "1.2", "ticked": [], "says": "knob is active"},
]
HINT = {"check": "1.2", "seen": "knob is empty", "look": "Plug it in."}
LESSON = {
    "lesson": "ring",
    "title": "The ring",
    "who": "ann",
    "since_s": 9.0,
    "people": ["bob"],
    "done": False,
    "checks": CHECKS,
    "progress": [{"person": "bob", "done": False, "ticked": ["1.1"], "hint": HINT}],
}
CLASS = {
    "frozen": {"by": "ann", "reason": "look here"},
    "groups": [{"group": "red", "pupils": ["bob", "eve"], "slots": ["fan"]}],
    "pupils": [
        {"pupil": "bob", "slots": ["fan"], "runs": True, "held": "frozen", "hand_s": 12.0},
        {"pupil": "eve", "slots": [], "runs": False, "held": "", "hand_s": None},
    ],
}
ANSWERS: dict[str, tuple[Any, dict[str, Any], list[str]]] = {
    "fault list": (
        msbot_school.cli.fault,
        FAULTS,
        [
            "fault  planted by  state                             what goes wrong",
            "    3  ann         there for 4 s, 56 s left, hidden  every third packet of fan is lost",
            "    4  -           -                                 a mission's fault",
        ],
    ),
    "lesson status": (
        msbot_school.cli.lesson,
        LESSON,
        [
            "The ring: begun by ann, 9 s ago",
            "check  ticked by  what it asks for",
            "  1.1  bob        fan is active",
            "  1.2  -          knob is active",
            "",
            "who  checks  stuck at",
            "bob  1 of 2  1.2: knob is empty. Plug it in.",
        ],
    ),
    "pupils list": (
        msbot_web.cli.user_commands,
        CLASS,
        [
            "FROZEN by ann: look here",
            "group  slots  pupils",
            "red    fan    bob, eve",
            "",
            "pupil  program  hand up  held",
            "bob    fan      12 s     frozen",
            "eve    -        -        -",
        ],
    ),
}


@pytest.mark.parametrize("call", ANSWERS)
def test_a_table(call: str, monkeypatch: pytest.MonkeyPatch) -> None:
    module, answer, lines = ANSWERS[call]
    monkeypatch.setattr(module, "perform", lambda *_: answer)
    done = CliRunner().invoke(msbot, call.split(), catch_exceptions=False)
    assert done.output.splitlines() == lines
