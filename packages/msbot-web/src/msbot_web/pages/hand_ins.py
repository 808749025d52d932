"""Work that was handed in: the list, and one of them, which a teacher comments and returns."""

from __future__ import annotations

import re
from typing import Final

from fastapi import Request
from nicegui import ui

from msbot.operations.rights import Right
from msbot.registry.hand_ins import HandIn
from msbot_agent.text.sentence import said
from msbot_web.access.sessions import Session
from msbot_web.hand_ins import MOST_NOTE
from msbot_web.html import render
from msbot_web.models.robot_models import ChangeResult
from msbot_web.pages.layout import BUILD_S, page_frame
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import heading, panel
from msbot_web.service import Service
from msbot_xrce.errors import MsbotError, NotThere

HAND_INS: Final = "hand-ins"
"""Where the list is on the page Learn."""
LOOK_S: Final = 3.0
"""How old the list may be."""


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/learn/hand_in/{number}", response_timeout=BUILD_S)
    async def hand_in(request: Request, number: str) -> None:
        with page_frame(service, request, "/learn", "Handed in") as page:
            try:
                found = await service.hand_ins.opened(page.session, _number(number))
                progress = await service.learning.progress(page.session, page.reads)
            except MsbotError as error:
                ui.label(page.translate(str(error))).classes("ms-banner warn")
                return
            row = next((one for one in progress if (one.person, one.lesson) == (found.person, found.lesson)), None)
            lesson = next(
                (one for one in (service.learning.lessons(page.reads) or ([], []))[0] if one.name == found.lesson), None
            )
            questions = {} if lesson is None else {check.name: check for check in lesson.checks if check.question}
            answers = [
                (questions[name].says if name in questions else name, answer, _is_right(service, found, name, answer))
                for name, answer in sorted((found.answers or {}).items())
            ]
            with panel():
                ui.html(
                    render(
                        "hand_in",
                        say=page.translate,
                        work=found,
                        title=found.lesson if lesson is None else lesson.title,
                        when=page.when(found.at_ns // 1_000_000),
                        ticked=""
                        if row is None
                        else page.translate("{ticked} of {checks}", ticked=row.ticked, checks=row.checks),
                        answers=answers,
                        moment=found.recorded_to_ns // 1_000_000,
                        begin=-(-found.recorded_from_ns // 1_000_000),
                        recording=_recording_words(page, found),
                        may_download=page.may(Right.ARRANGE),
                        returned=page.when(found.returned_ns // 1_000_000) if found.returned_ns else "",
                    ),
                    sanitize=False,
                )
            if page.may(Right.ARRANGE):
                _comment(page, found)


def _number(text: str) -> int:
    """The number in an address.

    Raises:
        NotThere: it is none, or none that anything can have.
    """
    if re.fullmatch(r"[1-9][0-9]{0,14}", text):
        return int(text)
    raise NotThere(said("nothing with the number {number} was handed in", number=text[:20]))


def _recording_words(page: Page, found: HandIn) -> str:
    """How long and how large the copy of the recording is; empty: there is none."""
    if not found.recording_octets:
        return ""
    return page.translate(
        "Recording of the robot: {minutes:.1f} min, {size:.2f} MB",
        minutes=(found.recorded_to_ns - found.recorded_from_ns) / 60e9,
        size=found.recording_octets / 1e6,
    )


def _is_right(service: Service, found: HandIn, check: str, answer: str) -> bool:
    return service.learning.is_right(found.lesson, check, answer)


def _comment(page: Page, found: HandIn) -> None:
    say = page.translate
    with panel().classes("no-print"):
        heading(say("Your comment"))
        field = (
            ui.textarea(say("Comment"), value=found.comment)
            .props(f"outlined autogrow maxlength={MOST_NOTE}")
            .classes("w-full")
        )

        async def give_back() -> None:
            async def deed(session: Session) -> ChangeResult:
                await page.service.hand_ins.give_back(session, found.number, str(field.value or ""))
                return ChangeResult(words=said("returned to {person}", person=found.person))

            if await page.do(deed) is not None:
                ui.navigate.to("/learn")

        ui.button(say("Return it"), icon="assignment_return", on_click=give_back).classes("q-mt-sm")


class HandInList:
    """What was handed in: everybody's for a teacher, one's own for others.

    Args:
        page: where.
        link: leads here from the top of the page, and says how many there are.
    """

    def __init__(self, page: Page, link: ui.link) -> None:
        self._page = page
        self._link = link
        self._seen: object = None
        self._read_at = float("-inf")
        ui.link_target(HAND_INS)
        with panel().classes("no-print") as self._panel:
            heading(page.translate("Handed in"))
            self._shown = ui.element("div").classes("w-full scroll").props("tabindex=0")
        for element in (self._panel, link):
            element.set_visibility(False)
        page.every_look(self._show, self._shown)

    async def _show(self) -> None:
        page, now = self._page, self._page.service.now()
        if now - self._read_at < LOOK_S:
            return
        self._read_at = now
        found = await page.service.hand_ins.listed(page.session)
        lessons = (page.service.learning.lessons(page.reads) or ([], []))[0]
        titles = {one.name: one.title for one in lessons}
        if (found, titles) == self._seen:
            return
        self._seen = (found, titles)
        for element in (self._panel, self._link):
            element.set_visibility(bool(found))
        words = page.translate("Handed in: {count}", count=len(found))
        waiting = sum(not one.returned_ns for one in found)
        if waiting and page.may(Right.ARRANGE):
            words = page.language.count(
                waiting,
                "Handed in: {all}; {count} of them waits for you",
                "Handed in: {all}; {count} of them wait for you",
                all=len(found),
            )
            if waiting == len(found) == 1:
                words = page.translate("Handed in: 1; it waits for you")
        self._link.set_text(words)
        size = sum(one.recording_octets for one in found) / 1e6
        lines = [(one, titles.get(one.lesson, one.lesson), page.when(one.at_ns // 1_000_000)) for one in found]
        self._shown.clear()
        with self._shown:
            ui.html(render("hand_ins", say=page.translate, lines=lines), sanitize=False)
            if size:
                ui.label(page.translate("Their recordings have {size:.2f} MB.", size=size)).classes("soft")
