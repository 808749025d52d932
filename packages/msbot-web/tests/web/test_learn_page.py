"""The page Learn, without a browser: what a teacher reads before a lesson begins."""

from __future__ import annotations

from pathlib import Path

import pytest
from nicegui import Client, ui
from nicegui.page import page as nicegui_page

from msbot.operations.rights import Role
from msbot_school.lessons.catalog import LessonCatalog
from msbot_school.lessons.lesson_controller import LessonController
from msbot_web.language import languages
from msbot_web.lessons_view import LessonsView
from msbot_web.pages import learn
from msbot_web.pages.page import Page
from tests.web.rig import Rig, belongs_to, show

STOPS = "Programs and parts of people stop: "


def questions(client: Client) -> list[str]:
    """What is asked, and not answered yet."""
    return [one.text for one in client.elements.values() if isinstance(one, ui.label) and STOPS in one.text]


@pytest.mark.parametrize(("lesson", "is_asked"), [("first_part", True), ("ring", False)])
def test_a_lesson_with_other_slots_asks_before_it_ends_the_programs_of_people(
    lesson: str, is_asked: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ui, "run_javascript", lambda *_, **__: None)

    async def scene(rig: Rig) -> None:
        await rig.look(2.0)
        belongs_to(rig, "BB", "Ben")
        shelf = LessonCatalog()
        rig.service.learning = LessonsView(LessonController(rig.stage.operations, shelf), None, rig.accounts)
        with Client(nicegui_page("/")) as client:
            page = Page(rig.service, rig.session(Role.TEACHER), languages()["en"])
            await learn._LessonList(page)._begin(shelf.get(lesson))
            assert bool(questions(client)) is is_asked
            assert all(", Ben (BB), " in words for words in questions(client))
        assert (rig.service.learning.lesson("en") is None) is is_asked

    show(tmp_path, scene)


def test_a_lesson_that_needs_another_robot_says_so_in_place_of_its_button(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        await rig.look(0.1)
        shelf = LessonCatalog()
        shelf.refresh()
        rig.service.learning = LessonsView(LessonController(rig.stage.operations, shelf), None, rig.accounts)
        with Client(nicegui_page("/")) as client:
            page = Page(rig.service, rig.session(Role.TEACHER), languages()["en"])
            learn._LessonList(page)._show()
            told = [one.text for one in client.elements.values() if isinstance(one, ui.label)]
            buttons = {one.props.get("aria-label") for one in client.elements.values() if isinstance(one, ui.button)}
        for name in ("bits_on_the_bus", "closing_the_loop"):
            assert any(f"`msbot demo --lesson {name}`" in words for words in told)
            assert f"Begin: {shelf.get(name).title}" not in buttons
        assert f"Begin: {shelf.get('spare').title}" in buttons

    show(tmp_path, scene, parts=())
