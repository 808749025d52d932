"""The arrivals tray, without a browser: whose cards are made anew, and when."""

from __future__ import annotations

from pathlib import Path

from nicegui import Client, ui
from nicegui.page import page as nicegui_page

from msbot.operations.rights import Role
from msbot_web.language import languages
from msbot_web.pages.page import Page
from msbot_web.pages.waiting_parts import ArrivalsPanel
from tests.web.rig import Rig, show


def buttons_of(tray: ui.element) -> dict[str, list[int]]:
    """The buttons of each card, by the part that is named in it."""
    found: dict[str, list[int]] = {}
    for card in tray.default_slot.children[1:]:
        facts, row = card.default_slot.children
        assert isinstance(facts, ui.html)
        name = next(name for name in ("FIRST", "SECOND") if name in facts.content)
        found[name] = [button.id for button in row.default_slot.children]
    return found


def test_a_card_and_its_menu_stay_while_parts_come_go_and_change(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        await rig.look(2.0)
        (some, *_) = rig.views.parts()
        one, two = (
            some.model_copy(update={"part": name, "uid": name, "client_key": name, "state": "refused", "refusal": "x"})
            for name in ("FIRST", "SECOND")
        )
        with Client(nicegui_page("/")), ui.element("div") as place:
            tray = ArrivalsPanel(Page(rig.service, rig.session(Role.TEACHER), languages()["en"]))
        _more, cards = place.default_slot.children
        tray.show([one])
        begun = buttons_of(cards)["FIRST"]
        tray.show([two, one])
        assert [*buttons_of(cards)] == ["SECOND", "FIRST"], "the newest first"
        tray.show([two, one.model_copy(update={"state": "late", "state_age_s": 3.0, "ignored": True})])
        assert "is-late" in cards.default_slot.children[2].classes
        assert buttons_of(cards)["FIRST"] == begun, "the same ones: a menu that was open is open"
        tray.show([one])
        assert buttons_of(cards) == {"FIRST": begun}
        tray.show([one.model_copy(update={"refusal": "blocked"})])
        assert buttons_of(cards)["FIRST"] != begun, "now it can be unblocked"
        tray.show([])
        assert buttons_of(cards) == {}

    show(tmp_path, scene)
