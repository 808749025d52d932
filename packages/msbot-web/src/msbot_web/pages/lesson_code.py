"""The texts of a lesson: programs in them can be copied, and opened in Program as a program of one's own."""

from __future__ import annotations

import re
from functools import partial
from typing import TYPE_CHECKING, Final

from nicegui import ui

from msbot.operations.rights import Right
from msbot.registry import ProgramSource
from msbot_agent.text.sentence import said
from msbot_web.access.sessions import Session
from msbot_web.lessons_view import text_html
from msbot_web.models.robot_models import ChangeResult

if TYPE_CHECKING:
    from msbot_web.pages.page import Page

_CODE: Final = re.compile(r"^```(?P<kind>\w*)[^\S\n]*\n(?P<code>.*?)^```[^\S\n]*$", re.DOTALL | re.MULTILINE)
_NAME: Final = re.compile(r"[^A-Za-z0-9_-]")


def show_text(page: Page, lesson: str, text: str) -> None:
    """Show a piece of a lesson, with buttons under each piece of code."""
    begin = 0
    for found in _CODE.finditer(text):
        _html(text[begin : found.start()])
        with ui.element("div").classes("ms-code w-full"):
            _html(found[0])
            with ui.element("div").classes("row"):
                copy = ui.button(page.translate("Copy"), icon="content_copy").props("outline")
                copy.on("click", js_handler="(event) => msbotLesson.copy(event.currentTarget)")
                if found["kind"] == "python" and page.may(Right.OPERATE):
                    words = page.translate("Open in Program")
                    ui.button(words, icon="code", on_click=partial(_open, page, lesson, found["code"])).props("outline")
        begin = found.end()
    _html(text[begin:])


def _html(text: str) -> None:
    if text.strip():
        ui.html(text_html(text), sanitize=False).classes("handbook w-full")


async def _open(page: Page, lesson: str, code: str) -> None:
    """Keep a program of the lesson as a new one of the person's, and go there."""
    programs = page.service.programs
    name = ""

    async def deed(session: Session) -> ChangeResult:
        nonlocal name
        mine = {one.name for one in await programs.mine(session)}
        word = _NAME.sub("_", lesson)[:30]
        name = next(free for number in range(1, 200) if (free := f"{word}{number}.py") not in mine)
        await programs.store(session, name, ProgramSource(code))
        return ChangeResult(words=said("{name} is a new program of yours.", name=name))

    if await page.do(deed) is not None:
        ui.navigate.to(f"/program?name={name}")
