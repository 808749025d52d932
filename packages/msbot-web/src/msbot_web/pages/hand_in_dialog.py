"""The dialog by which a pupil hands in what they have of a lesson."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nicegui import ui

from msbot_agent.text.sentence import said
from msbot_web.access.sessions import Session
from msbot_web.hand_ins import MOST_NOTE
from msbot_web.models.robot_models import ChangeResult
from msbot_web.pages.page_elements import page_dialog, show_dialog
from msbot_xrce.errors import MsbotError

if TYPE_CHECKING:
    from msbot_web.pages.page import Page


async def hand_in_dialog(page: Page) -> None:
    """Ask what is to be handed in, and hand it in."""
    say = page.translate
    try:
        programs = [one.name for one in await page.service.programs.mine(page.session)]
    except MsbotError as error:
        ui.notify(say(str(error)), type="negative", multi_line=True)
        return
    with page_dialog(page) as dialog, ui.card().style("width:min(30rem,92vw)"):
        ui.label(say("Hand in")).props("role=heading aria-level=2")
        ui.label(say("Your answers and the recording of your robot go with it.")).classes("soft")
        none = say("no program")
        choice = ui.select([none, *programs], value=programs[0] if programs else none, label=say("Program"))
        choice.props("outlined").classes("w-full")
        note = ui.textarea(say("What your teacher should know")).props(f"outlined autogrow maxlength={MOST_NOTE}")
        note.classes("w-full")

        async def do() -> None:
            async def deed(session: Session) -> ChangeResult:
                name = "" if choice.value == none else str(choice.value)
                number = await page.service.hand_ins.hand_in(session, name, str(note.value or ""))
                return ChangeResult(words=said("handed in, number {number}", number=number))

            if await page.do(deed) is not None:
                dialog.close()

        with ui.element("div").classes("row"):
            ui.button(say("Hand in"), icon="send", on_click=do)
            ui.button(say("Cancel"), on_click=dialog.close).props("flat")
    show_dialog(dialog)
