"""The page Pupils, without a browser: what it says before something is lost."""

from __future__ import annotations

from pathlib import Path

import pytest
from nicegui import Client, ui
from nicegui.page import page as nicegui_page

from msbot.operations.rights import Role
from msbot_web.class_controller import PupilTicket
from msbot_web.language import languages
from msbot_web.pages import pupils
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import END_WITH_MASTER
from msbot_web.pages.simulator import simulator_panel
from tests.web.rig import Rig, ToyBench, show


def told(client: Client) -> str:
    """Every label of a page."""
    return "\n".join(one.text for one in client.elements.values() if isinstance(one, ui.label))


@pytest.mark.parametrize("password", ["blue-fox-12", ""])
def test_that_passwords_are_lost_is_said_before_and_how_to_get_new_tickets(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, password: str
) -> None:
    monkeypatch.setattr(ui, "run_javascript", lambda _: None)

    async def scene(rig: Rig) -> None:
        with Client(nicegui_page("/")) as client:
            page = Page(rig.service, rig.session(Role.TEACHER), languages()["en"])
            accounts = pupils._Accounts(page, "http://robot/")
            assert "Tickets for all makes new ones" in told(client)
            accounts._print([PupilTicket("Ada", "Red", password, "/pass?word=x", ())])
            assert ("lost when the master ends" in told(client)) is bool(password)

    show(tmp_path, scene, parts=())


def test_it_is_said_that_a_stand_in_ends_with_the_master_and_a_part_of_the_demo_does_not(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        await rig.look(2.0)
        page = Page(rig.service, rig.session(Role.TEACHER), languages()["en"])
        with Client(nicegui_page("/")) as client:
            simulator_panel(page, "BB")
            assert END_WITH_MASTER not in told(client)
        await rig.act(page.session, "simulate", slot="BB", end=False)
        with Client(nicegui_page("/")) as client:
            simulator_panel(page, "BB")
            assert END_WITH_MASTER in told(client)
        with Client(nicegui_page("/")) as client:
            pupils._groups(page)
            assert END_WITH_MASTER in told(client)

    show(tmp_path, scene, bench=ToyBench("BB"))
