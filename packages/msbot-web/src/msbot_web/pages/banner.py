"""What everybody must know of the present, on every page: STOP and who has confirmed it, and what is not being stored."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nicegui import ui

from msbot.operations.rights import Right
from msbot_web.html import Markup, render
from msbot_web.models.robot_models import StopState
from msbot_web.pages.page_elements import set_html

if TYPE_CHECKING:
    from msbot_web.pages.page import Page


def show_banner(page: Page, banner: ui.column) -> None:
    """Show it in this place, and keep it true."""
    shown: list[object] = []

    def show() -> None:
        robot = page.service.glance()
        wanted: list[object] = [page.is_past, robot.stop.stopped, robot.trouble, robot.stop.trouble, *robot.faults]
        if wanted != shown:
            shown[:] = wanted
            banner.clear()
            with banner:
                if page.is_past and any(wanted[1:]):
                    ui.label(page.translate("At present:")).classes("soft")
                if robot.stop.stopped:
                    with ui.element("div").classes("ms-banner bad row spread").props("role=alert"):
                        stop_words.append(ui.html("", sanitize=False).style("flex:1;min-width:min(18rem,100%)"))
                        if page.may(Right.ARRANGE):
                            ui.button(page.translate("Go on"), on_click=go_on).props("outline dense")
                for words in (robot.trouble, robot.stop.trouble, *robot.faults):
                    if words:
                        with ui.element("div").classes("ms-banner warn").props("role=alert"):
                            ui.label(page.translate(words))
        if robot.stop.stopped and stop_words:
            set_html(stop_words[-1], _shared_stop_html(page, robot.stop))
            seen[0] = robot.stop.number

    async def go_on() -> None:
        await page.act("go", stop=seen[0])  # not a STOP that came since this person has looked

    seen = [0]
    stop_words: list[ui.html] = []
    page.every_look(show)


_shared: dict[tuple[str, bool], tuple[StopState, Markup]] = {}
"""By language and what a person may read: it is the same on all their pages, and long in a class."""


def _shared_stop_html(page: Page, stop: StopState) -> Markup:
    reader = (page.language.code, page.may(Right.ARRANGE))
    known = _shared.get(reader)
    if known is None or known[0] is not stop:
        known = _shared[reader] = (stop, stop_html(page, stop))
    return known[1]


def stop_html(page: Page, stop: StopState) -> Markup:
    """The state of STOP: who said it, who has confirmed it in how long, and who has not."""
    slowest = max((one.ms for one in stop.confirmed), default=0.0)
    told = len(stop.confirmed) + len(stop.silent)
    return render(
        "stop_state",
        say=page.translate,
        stop=stop,
        slowest=page.number(slowest, ".0f"),
        told=told,
        not_confirmed=page.language.count(
            len(stop.silent),
            "{count} of {told} parts has NOT confirmed it and may still move:",
            "{count} of {told} parts have NOT confirmed it and may still move:",
            told=told,
        ),
    )
