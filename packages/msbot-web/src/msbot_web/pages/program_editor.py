"""The editor of programs and blueprints."""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import TYPE_CHECKING, Any, Literal

from nicegui import ui
from nicegui.events import GenericEventArguments

from msbot.operations.rights import Right
from msbot_web.access.guest_tickets import MOST_GUESTS, TICKET_S, Ticket
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import show_dialog
from msbot_web.svg.drawings import qr_svg
from msbot_xrce.errors import MsbotError

if TYPE_CHECKING:
    from nicegui.elements.codemirror.constants import SUPPORTED_THEMES


_LIGHT: SUPPORTED_THEMES = "githubLight"
_DARK: SUPPORTED_THEMES = "githubDark"
"""Colours of the text whose contrast is enough to be read; that of CodeMirror's own light ones is not."""


class Editor(ui.codemirror):
    """CodeMirror, light or dark with its page. What is typed stays, whatever else of the editor is changed meanwhile.

    The browser tells the look of its page by itself: asked, it may be asleep and never answer.

    Args:
        text: what is in it at first.
        language: of the text.
    """

    def __init__(self, text: str, *, language: Literal["Python", "TOML"]) -> None:
        self._is_new = True
        super().__init__(text, language=language, theme=_LIGHT)
        self.on("update:value", js_handler=f"() => msbotTyped({self.id})")
        ui.on("ms_look", self._look)
        ui.run_javascript("msbotLook()")

    def _look(self, event: GenericEventArguments) -> None:
        self.theme = _DARK if event.args is True else _LIGHT

    def _handle_value_change(self, value: str) -> None:
        # What the browser has told is no news to it.
        self._is_new = self._is_new or self._send_update_on_value_change
        super()._handle_value_change(value)

    def _to_dict(self) -> dict[str, Any]:
        """What the browser is told. With the text only if that was set here: its own may be newer than ours."""
        told = super()._to_dict()
        if not self._is_new:
            told.setdefault("preserved_props", []).append("value")
        self._is_new = False
        return told


# The dialog that shares a program: with people who have an account, or by a ticket with devices that need none.


_ACCOUNT = 0
"""The choice of those who sign in; the others are numbers of guests."""


class ShareDialog:
    """See the comment above.

    Args:
        page: whose.
        base: the page's address as the person has opened it.
        name: the program.
        is_example: whether everybody has it under that name.
    """

    def __init__(self, page: Page, base: str, name: str, *, is_example: bool) -> None:
        self._page = page
        self._base = base.rstrip("/")
        self._name = name
        self._is_example = is_example
        self._ticket: Ticket | None = None
        self._until = ""

    async def show(self) -> None:
        """Open the dialog with a ticket for one device."""
        say = self._page.translate
        choices = {1: say("One phone, without an account")}
        if self._page.may(Right.ARRANGE):
            choices[MOST_GUESTS] = say("A class, without accounts")
        choices[_ACCOUNT] = say("People with an account")
        with ui.dialog() as dialog, ui.card().style("max-width:min(34rem,95vw)"):
            title = say("{name} on another device", name=self._name)
            ui.label(title).props("role=heading aria-level=2")
            self._choice = ui.radio(choices, value=1, on_change=self._renew)
            self._shown = ui.column().classes("w-full")
            self._state = ui.label().classes("soft").props("role=status")
            with ui.element("div").classes("row"):
                self._new = ui.button(say("New code"), on_click=self._renew).props("outline")
                ui.button(say("Close"), on_click=dialog.close).props("flat")
        await self._renew()
        self._page.every_look(self._look, dialog)
        show_dialog(dialog)

    async def _renew(self) -> None:
        """Make the link that was chosen, and show it."""
        page, guests = self._page, int(self._choice.value)
        deeds = page.service.programs
        self._ticket = None
        try:
            if guests != _ACCOUNT:
                path, self._ticket = await deeds.invite(page.session, self._name, guests)
            elif self._is_example:
                path = f"/program?name={self._name}"
            else:
                path = f"/program?shared={await deeds.share(page.session, self._name)}"
        except MsbotError as error:
            ui.notify(page.translate(str(error)), type="negative", multi_line=True, timeout=10_000)
            return
        if self._shown.is_deleted:  # the page was left meanwhile
            return
        self._until = f"{datetime.now().astimezone() + timedelta(seconds=TICKET_S):%H:%M}"
        self._show(self._base + path)
        self._look()

    def _show(self, link: str) -> None:
        say = self._page.translate
        self._shown.clear()
        with self._shown:
            ui.label(
                say("Whoever can sign in can open a copy by this link:")
                if self._ticket is None
                else say(
                    "Scan it with the phone's camera. Whoever does so runs this program as a part, sees the robot and can "
                    "press STOP, nothing else."
                )
            )
            if _is_only_here(self._base):
                ui.label(
                    say(
                        "This address leads to this computer only. For a phone start the robot with --host 0.0.0.0, and "
                        "open the page here by the address that it prints."
                    )
                ).classes("soft")
            else:
                ui.html(qr_svg(link, scale=5), sanitize=False)
            ui.label(link).classes("mono").style("user-select:all;overflow-wrap:anywhere")

    def _look(self) -> None:
        """How far the ticket is used: whoever shows it sees a stranger come in."""
        say, ticket = self._page.translate, self._ticket
        self._new.set_visibility(ticket is not None)
        if ticket is None:
            words = ""
        elif ticket.left:
            words = self._page.language.count(
                ticket.guests + ticket.left,
                "Valid until {time}; {guests} of {count} device has joined.",
                "Valid until {time}; {guests} of {count} devices have joined.",
                time=self._until,
                guests=ticket.guests,
            )
        else:
            words = say("Used. For another device make a new code.")
        if self._state.text != words:
            self._state.text = words


def _is_only_here(base: str) -> bool:
    host = base.partition("://")[2]
    return host.startswith(("127.", "localhost", "[::1]"))
