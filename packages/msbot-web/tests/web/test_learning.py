"""Lessons are read when somebody looks at them, or when the robot has settled, and never in the event loop."""

from __future__ import annotations

import asyncio
import threading
from html.parser import HTMLParser
from pathlib import Path

import pytest

from msbot_school.lessons.catalog import LessonCatalog
from msbot_school.lessons.lesson_controller import SETTLED_S, LessonController
from msbot_web.access.accounts import Accounts
from msbot_web.access.users import MemoryUsers
from msbot_web.lessons_view import LessonsView, text_html
from tests.lessons.lesson_stage import LessonStage, lesson_scene


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
