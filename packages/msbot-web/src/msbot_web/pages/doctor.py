"""The doctor's page: what is not as it should be, why it matters, and what mends it."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from fastapi import Request
from nicegui import ui

from msbot.operations.rights import Right
from msbot.operations.table import OPERATIONS
from msbot_web.html import render
from msbot_web.pages.layout import page_frame
from msbot_web.pages.page import Page
from msbot_web.service import BACKUP, Service
from msbot_xrce.errors import MsbotError

if TYPE_CHECKING:
    from msbot.doctor import Examination, Finding


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/doctor")
    def doctor(request: Request) -> None:
        with page_frame(service, request, "/doctor", "Doctor") as page:
            if not page.may(Right.ARRANGE):
                ui.label(page.translate("Only a teacher sees this page.")).classes("ms-banner warn")
                return
            _Findings(page)


class _Findings:
    """The list, and the button to look again."""

    def __init__(self, page: Page) -> None:
        self._page = page
        with ui.element("div").classes("row spread").style("margin-bottom:.75rem"):
            self._summary = ui.label(page.translate("The doctor is looking ...")).props("role=status aria-live=polite")
            self._again = ui.button(
                page.translate("Look again"),
                icon="refresh",
                on_click=lambda: page.show_when_ready(self._look(anew=True)),
            )
        self._list = ui.element("div").classes("w-full")
        page.show_when_ready(self._look(anew=False))

    async def _look(self, *, anew: bool) -> None:
        page = self._page
        self._again.disable()
        try:
            found = await page.service.examine(page.session, anew=anew)
        except MsbotError as error:
            self._summary.text = page.translate(str(error))
            return
        finally:
            self._again.enable()
        self._show(found)

    def _show(self, found: Examination) -> None:
        page, say = self._page, self._page.translate
        musts = sum(finding.must for _, finding in found.findings)
        self._summary.text = (
            page.language.count(musts, "{count} thing to mend", "{count} things to mend")
            if musts
            else say("Nothing to mend in what was looked at.")
            if found.not_seen
            else say("Nothing to mend.")
        )
        self._list.clear()
        with self._list:
            for check, finding in found.findings:
                with ui.element("section").classes("panel").style("margin-bottom:.75rem"):
                    ui.html(render("finding", say=say, check=check, finding=finding), sanitize=False).classes("w-full")
                    if finding.mending is not None and _may(page, finding):
                        words = say(WHAT_IT_DOES[finding.mending.name])
                        ui.button(words, icon="healing", on_click=partial(self._mend, finding)).props("flat dense")
            ui.html(render("examination", say=say, found=found), sanitize=False).classes("w-full")

    async def _mend(self, finding: Finding) -> None:
        page = self._page
        if await page.do(lambda session: page.service.repair(session, finding)) is not None:
            await self._look(anew=True)


WHAT_IT_DOES = {
    "simulate": "Mend: fill the slot with a simulated part",
    "unbind": "Mend: remove this wire",
    "unblock": "Mend: let it in again",
    BACKUP: "Mend: write a backup now",
}


def _may(page: Page, finding: Finding) -> bool:
    assert finding.mending is not None
    name = finding.mending.name
    return page.may(Right.ADMINISTER if name == BACKUP else OPERATIONS[name].right)
