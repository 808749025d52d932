"""The projector view: the class at a glance, big and calm, for the wall: no names unless wanted, no secrets ever."""

from __future__ import annotations

from fastapi import Request
from nicegui import ui

from msbot.operations.rights import Right
from msbot_web.html import render
from msbot_web.pages.layout import page_frame
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import set_html
from msbot_web.service import Service
from msbot_xrce.errors import MsbotError


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/projector")
    def projector(request: Request) -> None:
        with page_frame(service, request, "/projector", "Our class") as page:
            if not page.may(Right.ARRANGE):
                ui.label(page.translate("Only a teacher sees this page.")).classes("ms-banner warn")
                return
            _wall(page)


def _wall(page: Page) -> None:
    say = page.translate
    ui.query("body").classes("ms-projector")
    names = ui.switch(say("With names")).classes("ms-projector-switch")
    shown = ui.html("", sanitize=False).classes("w-full")

    async def show() -> None:
        service = page.service
        robot = service.robot()
        active = frozenset(card.name for card in robot.slots if card.state == "active")
        try:
            groups = await service.pupils.groups_now(page.session, service.views.pupils_here(), active)
        except MsbotError:
            return  # signed out: the page leaves by itself
        lesson = service.learning.lesson(page.language.code)
        frozen = service.operations.pupils.frozen
        set_html(
            shown,
            render(
                "wall",
                say=say,
                groups=groups,
                names=bool(names.value),
                stopped=robot.stopped,
                frozen=None if frozen is None else frozen.reason,
                lesson="" if lesson is None else lesson.title,
                slots=len(robot.slots),
                active=len(active),
                hands=sum(group.hands for group in groups),
                percent=lambda share: page.number(100 * share, ".0f"),
            ),
        )

    page.every_look(show)
    names.on_value_change(show)
