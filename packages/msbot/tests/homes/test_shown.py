"""What the page Program shows of a port's last message, in the VM that the page has."""

from __future__ import annotations

import pytest

from tests import ROOT
from tests.homes import micro, runners

SHOWN = ROOT / "micropython/browser/shown.py"


@pytest.mark.skipif(runners.NODE is None, reason="no node on this machine: apt-get install nodejs")
@pytest.mark.parametrize(
    ("number", "small", "large"),
    [
        ("0.1", "0.1", "0.1"),
        ("0.30000000000000004", "0.3", "0.30000000000000004"),
        ("40", "40.0", "40.0"),
        ("-12.34", "-12.34", "-12.34"),
        ("16777216", "16777216.0", "16777216.0"),
        ("0.333333333333", "0.33333334", "0.333333333333"),
        ("3e-40", "3e-40", "3e-40"),
        ("1e300", "inf", "1e+300"),
        ("inf", "inf", "inf"),
        ("nan", "nan", "nan"),
    ],
)
def test_a_float32_is_shown_with_the_digits_that_it_can_tell(number: str, small: str, large: str) -> None:
    engine = runners.NodeEngine(micro.FOLDER, f"shown={SHOWN}", str(runners.HERE / "shown_host.py"))
    told = engine.ask({"number": number})
    engine.close()
    words = """Sample(small={}, large={}, words="it's", inner=Inner(level={}))"""
    assert told["came"] == words.format(small, large, small)
    assert told["sent"] == words.format(small, large, small)
    assert told["bad"]
