"""tests/requirements.md names tests that exist."""

import re

from tests import FOLDERS, ROOT

CONFIGURES_ITSELF = (*range(10, 14), *range(50, 65), *range(78, 87))
"""Plug-and-play, the inventory, and the thesis' future work: each has a line of its own."""


def test_every_requirement_points_to_tests_that_exist() -> None:
    source = "\n".join(path.read_text() for folder in FOLDERS for path in folder.rglob("test_*.py"))
    tests = set(re.findall(r"def (test_\w+)\(", source))
    page = (ROOT / "tests/requirements.md").read_text()
    rows = [line for line in page.splitlines() if re.match(r"\| [RT]\d", line)]
    missing = [number for number in CONFIGURES_ITSELF if not any(row.startswith(f"| R{number} |") for row in rows)]
    assert missing == []
    for row in rows:
        names = re.findall(r"`(test_\w+)`", row)
        assert names, row
        for name in names:
            found = name in tests or (name.endswith("_") and any(test.startswith(name) for test in tests))
            assert found, f"{row.split('|')[1].strip()}: there is no test {name}"
