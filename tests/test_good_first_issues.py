"""Each gap that GOOD_FIRST_ISSUES.md names is still there, and what it points to exists."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
TEXT = (ROOT / "GOOD_FIRST_ISSUES.md").read_text("utf-8")
TYPES = ROOT / "packages/msbot/src/msbot/config/library/types"


def has_no_driver(number: str) -> bool:
    return bool(re.search(r"^none = ", (TYPES / f"{number}.toml").read_text("utf-8"), re.MULTILINE))


GAPS: dict[str, Callable[[], bool]] = {
    "Lessons in French": lambda: not (ROOT / "lessons/fr").exists(),
    "A part type for your sensor": lambda: len(list(TYPES.glob("*.toml"))) < 100,
    "A driver for the display SSD1306": lambda: has_no_driver("SSD1306"),
    "Calibrate the compass HMC5883L": lambda: has_no_driver("HMC5883L"),
    "A page in Spanish": lambda: not (ROOT / "packages/msbot-web/src/msbot_web/languages/es.po").exists(),
    "Start at boot on macOS": lambda: (
        "launchd" not in (ROOT / "packages/msbot/src/msbot/cli/service.py").read_text("utf-8")
    ),
}


def test_the_list_and_this_test_name_the_same() -> None:
    assert re.findall(r"^## (.*)$", TEXT, re.MULTILINE) == list(GAPS)


@pytest.mark.parametrize("title", GAPS)
def test_the_gap_is_still_there(title: str) -> None:
    assert GAPS[title](), f"{title}: it is closed, so GOOD_FIRST_ISSUES.md must not name it"


def test_what_the_list_points_to_exists() -> None:
    paths = [path for path in re.findall(r"`([\w./-]+/[\w./-]+)`", TEXT) if not path.endswith("es.po")]
    assert [path for path in paths if not (ROOT / path).exists()] == []


@pytest.mark.parametrize("name", ["SECURITY.md", "GOVERNANCE.md", "GOOD_FIRST_ISSUES.md", "CODE_OF_CONDUCT.md"])
def test_links_lead_somewhere(name: str) -> None:
    targets = re.findall(r"\]\((?!https?://|#)([^)#]+)(?:#[^)]*)?\)", (ROOT / name).read_text("utf-8"))
    assert [target for target in targets if not (ROOT / target).exists()] == []
