"""What pages say of a STOP: one part that has not confirmed it is one, in each language."""

from __future__ import annotations

from pathlib import Path

import pytest

from msbot.operations.rights import Role
from msbot_web.language import languages
from msbot_web.models.robot_models import StopState
from msbot_web.pages.banner import stop_html
from msbot_web.pages.page import Page
from tests.web.rig import Rig, show


@pytest.mark.parametrize(
    ("code", "one", "two"),
    [
        ("en", "1 of 1 parts has NOT confirmed it", "2 of 2 parts have NOT confirmed it"),
        ("de", "1 von 1 Teilen hat es NICHT bestätigt", "2 von 2 Teilen haben es NICHT bestätigt"),
        ("fr", "1 composant sur 1 ne l&#39;a PAS confirmé", "2 composants sur 2 ne l&#39;ont PAS confirmé"),
    ],
)
def test_one_part_that_has_not_confirmed_is_one(code: str, one: str, two: str, tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        page = Page(rig.service, rig.session(Role.TEACHER), languages()[code])
        assert one in stop_html(page, StopState(stopped=True, by="Ada", silent=["fan"]))
        assert two in stop_html(page, StopState(stopped=True, by="Ada", silent=["fan", "horn"]))

    show(tmp_path, scene, parts=())
