"""The drawer of a slot, without a browser: what a click is for while the drawer follows the robot."""

from __future__ import annotations

from pathlib import Path

import pytest
from nicegui import Client, ui
from nicegui.element import Element
from nicegui.page import page as nicegui_page

from msbot.operations.rights import Role
from msbot_web.language import languages
from msbot_web.pages import slot_drawer
from msbot_web.pages.page import Page
from msbot_web.pages.simulator import simulator_panel
from tests.operations.stage import AA_IS_A_DIAL
from tests.web.rig import Rig, ToyBench, show


def words_of(row: Element) -> dict[str, int]:
    """The buttons of a row, in their order, by what stands on them."""
    buttons = [one for one in row.default_slot.children if isinstance(one, ui.button)]
    return {button.text: button.id for button in buttons}


def test_a_button_is_the_same_one_as_long_as_it_would_do_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scene(rig: Rig) -> None:
        await rig.look(2.0)
        spares = [rig.views.parts()[0].model_copy(update={"part": "DD", "uid": "dd", "state": "standby"})]
        monkeypatch.setattr(slot_drawer, "_spares", lambda _: spares)
        with Client(nicegui_page("/")), ui.element("div") as place:
            page = Page(rig.service, rig.session(Role.TEACHER), languages()["en"])
            slot_drawer._PartActions(page, "AA")
        (row,) = place.default_slot.children
        begun = words_of(row)
        assert [*begun] == ["Identify", "Release slot", "Block part", "Swap to DD", "Simulate this slot"]
        spares.clear()
        page.refresh()
        assert words_of(row) == {words: number for words, number in begun.items() if words != "Swap to DD"}
        spares.append(rig.views.parts()[0].model_copy(update={"part": "EE", "uid": "ee", "state": "standby"}))
        page.refresh()
        now = words_of(row)
        assert [*now] == ["Identify", "Release slot", "Block part", "Swap to EE", "Simulate this slot"]
        assert now["Simulate this slot"] == begun["Simulate this slot"]
        spares.clear()
        rig.stage.pull("AA")
        await rig.look(2.0)
        page.refresh()
        assert [*words_of(row)] == ["Identify", "Release slot", "Block part", "Forget part", "Simulate this slot"]

    show(tmp_path, scene, bench=ToyBench())


def drawn_service(rig: Rig, role: Role) -> tuple[slot_drawer._ServiceControl, Page]:
    """The control of the service at slot AA, as somebody of that role has it."""
    declared = rig.views.library.require("DIAL").port("echo")
    assert declared is not None
    assert declared.message is not None
    with Client(nicegui_page("/")), ui.element("div"):
        page = Page(rig.service, rig.session(role), languages()["en"])
        return slot_drawer._ServiceControl(page, "AA", declared, declared.message), page


def test_a_service_that_nobody_calls_gets_its_wire_in_the_drawer(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        await rig.look(2.0)
        (student, _), (teacher, page) = drawn_service(rig, Role.STUDENT), drawn_service(rig, Role.TEACHER)
        assert [*words_of(student._unwired)] == []
        assert [*words_of(teacher._unwired)] == ["Make its wire"]
        assert (teacher._unwired.visible, teacher._button.visible) == (True, False)
        with teacher._unwired:
            await teacher._wire()
        await rig.look(1.0)
        made = next(line for line in rig.views.topics() if "AA.echo" in line.publishers)
        assert (made.topic, made.type_name, made.subscribers) == ("echo", "HelloWorld -> HelloWorld", [])
        page.refresh()
        assert (teacher._unwired.visible, teacher._button.visible) == (False, True)
        called = await rig.act(rig.session(Role.STUDENT), "call", port="AA.echo", values=["index=0", "message=hi"])
        assert called.words == "AA.echo: index 0, message hi"
        with teacher._unwired:
            await teacher._wire()
        assert len([line for line in rig.views.topics() if "AA.echo" in line.publishers]) == 1

    show(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL",))


def test_a_click_on_the_plug_is_done_before_a_refresh_could_take_it_back(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        bench = rig.views.bench
        with Client(nicegui_page("/")), ui.element("div") as place:
            page = Page(rig.service, rig.session(Role.TEACHER), languages()["en"])
            simulator_panel(page, "AA")
        switch = next(one for one in place.descendants() if isinstance(one, ui.switch))
        assert switch.value is True
        switch.set_value(False)  # as a click does
        page.refresh()
        assert bench.is_plugged("AA") is switch.value is False
        bench.plug("AA")  # by somebody else
        page.refresh()
        assert bench.is_plugged("AA") is switch.value is True

    show(tmp_path, scene, bench=ToyBench("AA"))
