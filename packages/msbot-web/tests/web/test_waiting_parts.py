"""The arrivals tray, without a browser: whose cards are made anew, and when."""

from __future__ import annotations

from pathlib import Path

from nicegui import Client, ui
from nicegui.page import page as nicegui_page

from msbot.operations.rights import Role
from msbot_web.language import languages
from msbot_web.models.robot_models import ChangeResult
from msbot_web.pages import waiting_parts, wires
from msbot_web.pages.page import Page
from msbot_web.pages.slot_dialogs import make_wire
from msbot_web.pages.waiting_parts import ArrivalsPanel
from tests.operations.stage import AA_IS_A_DIAL
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


def pressable(place: ui.element) -> dict[str, ui.button]:
    """The buttons in it, by what is on them."""
    return {button.text: button for button in place.descendants() if isinstance(button, ui.button)}


def test_a_new_part_is_offered_the_wires_that_fit_and_those_for_people(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        await rig.look(2.0)
        done = ChangeResult.model_validate(
            {
                "words": "adopted",
                "offers": [{"topic": "t", "type": "HelloWorld", "from": "AA.out", "to": ["BB.in"]}],
                "for_people": [{"topic": "echo", "type": "HelloWorld -> HelloWorld", "from": "AA.echo", "to": []}],
                "by_hand": [{"topic": "in", "type": "HelloWorld", "from": "", "to": ["AA.in"]}],
            }
        )
        with Client(nicegui_page("/")), ui.element("div") as place:
            page = Page(rig.service, rig.session(Role.TEACHER), languages()["en"])
            for offers in (done.offers, done.for_people, done.by_hand):
                waiting_parts._offers(page, "words", offers)
        assert list(pressable(place)) == ["AA.out → BB.in", "AA.echo", "AA.in"]

    show(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL",))


def test_the_page_wires_offers_each_port_without_one_a_wire_of_its_own(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        await rig.look(2.0)
        with Client(nicegui_page("/")), ui.element("div") as place:
            page = Page(rig.service, rig.session(Role.TEACHER), languages()["en"])
            wires._Unwired(page)
        page.refresh()
        assert "AA.echo" in pressable(place)
        assert "AA.ask" not in pressable(place), "it calls, and nobody serves"
        with place:
            await make_wire(page, "AA.echo")
        await rig.look(1.0)
        page.refresh()
        assert "AA.echo" not in pressable(place)
        called = await rig.act(rig.session(Role.STUDENT), "call", port="AA.echo", values=["index=0", "message=hi"])
        assert called.words == "AA.echo: index 0, message hi"

    show(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL",))
