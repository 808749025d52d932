"""Every case of the conformance list has a test that carries its number."""

from __future__ import annotations

import re
from pathlib import Path

CASES = {f"{number:02d}" for number in range(1, 94)} | {"81b", "81c", "81d"}


def test_every_case_has_a_test() -> None:
    found = {
        number
        for file in Path(__file__).parent.glob("test_conformance_*.py")
        for number in re.findall(r"^(?:async )?def test_case_(\d\d[a-z]?)_", file.read_text(), re.MULTILINE)
    }
    assert found == CASES
