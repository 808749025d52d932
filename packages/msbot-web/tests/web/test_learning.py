"""Lessons are read when somebody looks at them, or when the robot has settled, and never in the event loop."""

from __future__ import annotations

import asyncio
import re
import threading
from html.parser import HTMLParser
from pathlib import Path

import pytest

import msbot_web
from msbot_school.lessons.catalog import LessonCatalog, shipped_folder
from msbot_school.lessons.lesson_controller import SETTLED_S, LessonController
from msbot_web.access.accounts import Accounts
from msbot_web.access.users import MemoryUsers
from msbot_web.language import languages
from msbot_web.lessons_view import LessonsView, text_html
from msbot_web.pages.lesson_view import pointed_at
from msbot_web.pages.menu import MENU
from tests.lessons.lesson_stage import LessonStage, lesson_scene

BLOCK_WORDS = {"Numbers", "Ports", "Python", "STOP", "Send", "Sense", "When"}
"""On the drawers of the blocks, which a script makes, and on the red button."""


class WatchedShelf(LessonCatalog):
    """Notes which threads read."""

    def __init__(self) -> None:
        super().__init__()
        self.read_by: list[threading.Thread] = []

    def refresh(self) -> None:
        self.read_by.append(threading.current_thread())
        super().refresh()


async def until_read(shelf: LessonCatalog) -> None:
    while not shelf.is_read:  # noqa: ASYNC110 - nothing says so
        await asyncio.sleep(0.1)


def test_who_looks_before_they_are_read_has_them_read_at_once(tmp_path: Path) -> None:
    async def scene(stage: LessonStage) -> None:
        shelf = WatchedShelf()
        learning = LessonsView(
            LessonController(stage.operations, shelf), None, Accounts(MemoryUsers(), clock=lambda: 0.0)
        )
        assert learning.lessons() is None
        assert learning.lessons() is None
        await until_read(shelf)
        found = learning.lessons()
        assert found is not None
        assert len(found[0]) > 5
        assert threading.main_thread() not in shelf.read_by
        assert len(shelf.read_by) == 1

    lesson_scene(tmp_path, scene)


def test_they_are_read_when_the_robot_has_settled(tmp_path: Path) -> None:
    async def scene(stage: LessonStage) -> None:
        shelf = WatchedShelf()
        running = asyncio.ensure_future(LessonController(stage.operations, shelf).run())
        await asyncio.sleep(SETTLED_S - 0.1)
        assert not shelf.read_by
        await until_read(shelf)
        running.cancel()
        assert threading.main_thread() not in shelf.read_by

    lesson_scene(tmp_path, scene)


@pytest.mark.parametrize(
    "text",
    [
        "[a](javascript:x)",
        "[a](javascript&#58;x)",
        "[a](&#106;avascript&colon;x)",
        "[a](data:text/html,x)",
        "[a][b]\n\n[b]: javascript&#58;x",
        "![a](javascript:x)",
        "![a](http://elsewhere.example/x.png)",
        "![a](//elsewhere.example/x.png)",
        "<img src=x onerror=x>",
        '![a](x"onerror="x)',
        "[a](x 'a\" onclick=\"x')",
    ],
)
@pytest.mark.promise("Texts and files of strangers are shown as text in the browser, and nothing in them runs")
def test_a_lesson_of_a_stranger_has_no_link_that_runs_and_no_picture_from_elsewhere(text: str) -> None:
    found: list[tuple[str, dict[str, str | None]]] = []

    class Reader(HTMLParser):
        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            found.append((tag, dict(attrs)))

    Reader().feed(text_html(text))
    for tag, attributes in found:
        assert not [name for name in attributes if name.startswith("on")], (tag, attributes)
        assert not (attributes.get("href") or "").partition(":")[1]
        assert ":" not in (attributes.get("src") or "")
        assert not (attributes.get("src") or "").startswith("//")


def test_what_markdown_can_do_stays() -> None:
    html = text_html(
        "| a | b |\n|:--|--:|\n| **1** | `2` |\n\n[c](/library/LED) [d](https://school.example/x) ![e](/web/icon.svg)"
    )
    for piece in (
        "<table>",
        "text-align",
        "<strong>1</strong>",
        "<code>2</code>",
        'href="/library/LED"',
        'href="https://school.example/x"',
        'src="/web/icon.svg"',
    ):
        assert piece in html


def words_pressed(folder: str) -> set[str]:
    """What the lessons of a folder set in bold: pages, and what is on buttons."""
    files = (shipped_folder() / folder).glob("*.md")
    words = {word for file in files for word in re.findall(r"\*\*([^*\n]+)\*\*", file.read_text())}
    return {word for word in words if not word.endswith(":")}  # that begins a paragraph


@pytest.mark.parametrize(("folder", "code"), [("", "en"), ("en-simple", "en"), ("de", "de"), ("de-simple", "de")])
def test_what_a_lesson_tells_to_press_is_on_a_button_in_that_language(folder: str, code: str) -> None:
    german = languages()["de"]
    english = set(
        re.findall(
            r"\.translate\(\s*\"([^\"]+)\"|\b(?:say|translate)\(\"([^\"]+)\"",
            "".join(file.read_text() for file in (Path(msbot_web.__file__).parent / "pages").glob("*.py")),
        )
    )
    shown = {one for pair in english for one in pair if one} | BLOCK_WORDS | {entry.title for entry in MENU}
    wanted = {german.translate(one) for one in shown} if code == "de" else shown
    assert words_pressed(folder) <= wanted


def test_a_step_points_at_what_is_still_to_be_done() -> None:
    lesson = LessonCatalog().get("first_part")
    step = next(one for one in lesson.steps if one.title.startswith("2."))
    found = pointed_at(step, step.checks)
    assert found == {"slots": ["knob"], "ports": [], "isWire": False, "words": ["Plug in"]}
    assert pointed_at(step, ())["words"] == []
    ring = next(one for one in LessonCatalog().get("ring").steps if one.title.startswith("2."))
    wire = [check for check in ring.checks if check.name == "2.2"]
    assert pointed_at(ring, wire)["ports"] == ["CC.out", "AA.in"]
    assert pointed_at(ring, wire)["isWire"] is True


def test_the_list_says_what_a_lesson_is_about_for_whom_and_what_comes_before() -> None:
    lessons, wrong = LessonCatalog().all()
    assert wrong == []
    names = {one.name for one in lessons}
    for lesson in lessons:
        assert lesson.topic, lesson.name
        assert 10 <= lesson.age <= 18, lesson.name
        assert set(lesson.needs) <= names, lesson.name
        before = {one.name: one.number for one in lessons}
        assert all(before[need] < lesson.number for need in lesson.needs), lesson.name
