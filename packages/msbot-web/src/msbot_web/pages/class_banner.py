"""What everybody in a class must know, on every page: that it is frozen, or that a teacher has one's program; and the
hand by which a pupil asks for help."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from nicegui import ui

from msbot.operations.rights import Right

if TYPE_CHECKING:
    from msbot_web.pages.page import Page


def show_class_banner(page: Page, place: ui.column) -> None:
    """Show it in this place, and keep it true."""
    control, me = page.service.operations.pupils, page.session.name
    is_teacher = page.may(Right.ARRANGE)
    shown: list[str] = []

    def show() -> None:
        words = control.freeze_words if is_teacher else control.held(me)
        taken = None if is_teacher else control.taken_by(me)
        if not words and taken is not None:
            words = page.translate("{by} runs your program now, and gives it back to you.", by=taken.by)
        if [words] == shown:
            return
        shown[:] = [words]
        place.clear()
        if not words:
            return
        with place, ui.element("div").classes("ms-banner info row spread ms-class-strip").props("role=alert"):
            ui.label(page.translate(words)).style("flex:1;min-width:min(18rem,100%)")
            if is_teacher:
                ui.button(page.translate("Let the class go on"), on_click=partial(page.act, "thaw")).props(
                    "outline dense"
                )

    page.every_look(show)


def raise_hand_button(page: Page) -> None:
    """A pupil's hand: up or down."""
    if page.may(Right.ARRANGE) or not page.may(Right.OPERATE):
        return
    control, me = page.service.operations.pupils, page.session.name

    async def press() -> None:
        await page.act("hand", down=me in control.hands)

    button = ui.button(icon="pan_tool", on_click=press).props("flat round dense color=primary").classes("ms-hand")
    shown: list[bool] = []

    def show() -> None:
        is_up = me in control.hands
        if [is_up] != shown:
            shown[:] = [is_up]
            words = (
                page.translate("Take your hand down")
                if is_up
                else page.translate("Put your hand up: ask the teacher for help")
            )
            button.props["aria-label"] = button.props["title"] = words
            button.props["aria-pressed"] = "true" if is_up else "false"
            button.props(f"color={'warning' if is_up else 'primary'}")
            button.classes(add="up") if is_up else button.classes(remove="up")
            button.update()

    page.every_look(show)
