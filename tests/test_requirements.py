"""docs/reference/requirements.md names tests that exist."""

import re
from pathlib import Path

ROOT = Path(__file__).parent.parent


def test_every_requirement_points_to_tests_that_exist() -> None:
    source = "\n".join(path.read_text() for path in (ROOT / "tests").rglob("test_*.py"))
    tests = set(re.findall(r"def (test_\w+)\(", source))
    page = (ROOT / "docs/reference/requirements.md").read_text()
    rows = [line for line in page.splitlines() if re.match(r"\| [RT]\d", line)]
    assert len(rows) >= 39
    for row in rows:
        names = re.findall(r"`(test_\w+)`", row)
        assert names, row
        for name in names:
            found = name in tests or (name.endswith("_") and any(test.startswith(name) for test in tests))
            assert found, f"{row.split('|')[1].strip()}: there is no test {name}"
