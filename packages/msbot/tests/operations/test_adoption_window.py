"""The adoption window closes by itself."""

from __future__ import annotations

import math

import pytest

from msbot.operations.placement import AdoptionWindow
from msbot_xrce.errors import ConfigError


def test_it_is_open_for_so_long_and_can_be_opened_anew() -> None:
    window = AdoptionWindow()
    assert window.remaining_s(0.0) == 0.0
    window.open(60, "BB", "ann", 100.0)
    assert (window.remaining_s(100.0), window.remaining_s(159.5), window.remaining_s(161.0)) == (60.0, 0.5, 0.0)
    window.open(10, None, "bob", 200.0)
    assert (window.slot, window.who, window.remaining_s(205.0)) == (None, "bob", 5.0)
    window.close()
    assert window.remaining_s(205.0) == 0.0


@pytest.mark.parametrize("seconds", [0.0, 0.99, 3601.0, -1.0, math.nan, math.inf])
def test_a_time_out_of_range_is_refused(seconds: float) -> None:
    with pytest.raises(ConfigError, match="it must be 1 to 3600 s"):
        AdoptionWindow().open(seconds, None, "ann", 0.0)
