"""The word on every page that a part is lost, without a browser."""

from __future__ import annotations

from pathlib import Path

import pytest
from nicegui import Client, ui
from nicegui.page import page as nicegui_page

from msbot.operations.rights import Role
from msbot_web.language import languages
from msbot_web.pages import lost_parts
from msbot_web.pages.page import Page
from tests.web.rig import Rig, show


@pytest.mark.parametrize("is_closed", [False, True], ids=["shown", "closed by somebody"])
def test_it_is_taken_back_when_the_part_returns_unless_it_is_gone_already(
    is_closed: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lost = set[str]()
    taken_back: list[ui.notification] = []

    def take_back(shown: ui.notification) -> None:
        taken_back.append(shown)

    monkeypatch.setattr(lost_parts, "lost_slots", lambda _: frozenset(lost))
    monkeypatch.setattr(ui.notification, "dismiss", take_back)

    async def scene(rig: Rig) -> None:
        await rig.look(0.1)
        with Client(nicegui_page("/")) as client:
            page = Page(rig.service, rig.session(Role.TEACHER), languages()["en"])
            lost_parts.notify_lost(page)
            page.refresh()
            lost.add("BB")
            page.refresh()
            (shown,) = [one for one in client.elements.values() if isinstance(one, ui.notification)]
            if is_closed:
                shown.delete()
            lost.clear()
            page.refresh()
            assert taken_back == ([] if is_closed else [shown])

    show(tmp_path, scene, parts=())
