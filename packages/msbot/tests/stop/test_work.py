"""Nothing reaches the fan after all have confirmed STOP, whatever people do with the robot."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.stop.work import DEEDS, SAYERS, work_story


@pytest.mark.promise("Nothing is heard after all parts have confirmed STOP, whatever they are and whatever happens")
@pytest.mark.parametrize("deed", [*DEEDS, *SAYERS])
def test_nothing_is_heard_after_all_have_confirmed(deed: str, tmp_path: Path) -> None:
    verdict = work_story(tmp_path, deed)
    assert verdict.is_right, verdict
