"""Nothing is heard after all have confirmed STOP, whatever becomes of the ways to them."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.firmware.pipe import Firmware
from tests.stop.ways import CUTS, agents_story, takeover_story

PROMISE = "Nothing is heard after all parts have confirmed STOP, whatever they are and whatever happens"


@pytest.mark.promise(PROMISE)
@pytest.mark.parametrize("cut", CUTS)
def test_nothing_is_heard_after_all_have_confirmed_at_agents_that_are_cut_off(cut: str) -> None:
    verdict = agents_story(cut)
    assert verdict.is_right, verdict


@pytest.mark.promise(PROMISE)
def test_nothing_is_heard_while_another_master_takes_over(tmp_path: Path, firmware: Firmware) -> None:
    verdict = takeover_story(tmp_path, firmware)
    assert verdict.is_right, verdict
