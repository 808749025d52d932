"""Pieces that pages are made of: headings, panels, dialogs, and buttons that take a file."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING

from nicegui import ui
from nicegui.events import UploadEventArguments

from msbot_web.access.access_middleware import CSRF_HEADER
from msbot_web.html import Markup, render
from msbot_web.nicegui_internals.removed_routes import forget_functions

if TYPE_CHECKING:
    from msbot_web.pages.page import Page

END_WITH_MASTER = "Simulated parts end with the master: simulate them again after its next start."


def set_html(element: ui.html, content: Markup) -> None:
    """Show something if it is not shown already: what stays the same is not sent again."""
    if element.content != content:
        element.set_content(content)


def show_dialog(dialog: ui.dialog, address: str = "") -> None:
    """Open a dialog that goes for good when it is closed, also by Back."""

    ui.on(f"ms_close_{dialog.id}", dialog.close)
    # As soon as it goes: a Back that comes before it has gone is for what lies under it.
    dialog.on("before-hide", js_handler=f"() => msbot.closed({dialog.id})")
    dialog.on("hide", dialog.delete)
    dialog.open()
    ui.run_javascript(f"msbot.opened({dialog.id}, {address!r})")


def page_dialog(page: Page) -> ui.dialog:
    """A dialog of the page itself: a list that its button is in may be drawn anew while it is open."""
    with page.in_page():
        return ui.dialog()


def ask_first(
    page: Page, words: str, deed: Callable[[], Awaitable[object]], refused: Callable[[], None] = lambda: None
) -> None:
    """Ask once more before something is done.

    Args:
        page: where.
        words: the question.
        deed: what a Yes does.
        refused: what happens when the person would rather not: Cancel, Escape, Back.
    """
    answers: list[bool] = []
    # Escape leaves it, as every other dialog: who presses it twice, because nothing happens, says STOP.
    with page_dialog(page).props("no-backdrop-dismiss") as dialog, ui.card():
        ui.label(words).props("role=heading aria-level=2")
        with ui.element("div").classes("row"):

            async def do() -> None:
                answers.append(True)
                dialog.close()
                with page.in_page():  # the dialog is gone by then
                    await deed()

            def hidden() -> None:
                if not answers:
                    with page.in_page():
                        refused()

            ui.button(page.translate("Yes"), on_click=do)
            ui.button(page.translate("Cancel"), on_click=dialog.close).props("flat")
    dialog.on("hide", hidden)
    show_dialog(dialog)


def heading(words: str) -> ui.html:
    """A heading inside a page."""
    return ui.html(render("heading", words=words), sanitize=False)


def panel() -> ui.element:
    """A card that holds a part of a page."""
    return ui.element("div").classes("panel")


def menu_item(words: str, deed: Callable[[], object]) -> ui.menu_item:
    """An entry of a menu; screen readers hear it as one, which those of Quasar itself are not."""
    return ui.menu_item(words, deed).props("role=menuitem")


def file_button(
    page: Page, title: str, taken: Callable[[UploadEventArguments], Awaitable[None]], *, max_size: int, ending: str = ""
) -> ui.button:
    """A button that takes a file from the person's computer, and shows that it is on its way.

    Args:
        page: where.
        title: what is on it.
        taken: what is done with the file.
        max_size: octets that it may have.
        ending: of the file's name.
    """
    upload = ui.upload(
        on_upload=taken,
        auto_upload=True,
        max_file_size=max_size,
        on_rejected=lambda: ui.notify(
            page.translate(
                "This file is not accepted: at most {size} kB{ending}.",
                size=f"{max_size // 1000:,}",
                ending=ending and f", *{ending}",
            ),
            type="negative",
        ),
    ).classes("hidden")
    ui.context.client.on_delete(forget_functions)
    upload.props["headers"] = [{"name": CSRF_HEADER, "value": page.session.csrf}]
    if ending:
        upload.props(f"accept={ending}")
    button = ui.button(title, icon="upload_file").props("outline")
    # Without a detour by the server: browsers open the dialog only in answer to a click.
    button.on("click", js_handler=f"() => runMethod({upload.id}, 'pickFiles', [])")
    upload.on("start", lambda: button.props("loading"), args=[])
    upload.on("finish", lambda: button.props(remove="loading"), args=[])
    upload.on(
        "failed", lambda: ui.notify(page.translate("The file did not arrive: try again."), type="negative"), args=[]
    )
    return button
