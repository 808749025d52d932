"""The page Program of a pupil, as a teacher may look at it, hold it and take it over."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence

from nicegui import ui
from nicegui.elements.codemirror import CodeMirror
from nicegui.elements.mixins.disableable_element import DisableableElement

from msbot.operations.rights import Right
from msbot.web.pages.layout import Page


class UnderTeacher:
    """One open page; a `Screen` for whoever has taken it over.

    Args:
        page: the page.
        editor: what is typed into.
        buttons: what the pupil cannot press while a teacher has the program.
        name: of the program that is open.
        put_in: puts another text in the editor; the program is text from then on, also where it was blocks.
    """

    def __init__(
        self, page: Page, editor: CodeMirror, buttons: Sequence[DisableableElement], name: Callable[[], str],
        put_in: Callable[[str], None],
    ) -> None:  # fmt: skip
        self._page = page
        self._editor = editor
        self._buttons = buttons
        self._name = name
        self._put_in = put_in
        self._shown: tuple[str, bool] = ("", False)
        if page.may(Right.ARRANGE) or page.client is None:
            return
        page.client.on_delete(page.service.pupils.opened(page.session.name, self))
        page.every_look(self._follow)

    def program(self) -> tuple[str, str]:
        """See `Screen`."""
        return self._name(), str(self._editor.value or "")

    def show(self, text: str) -> None:
        """See `Screen`."""
        with self._page.here():
            self._put_in(text)

    def run(self) -> None:
        """See `Screen`."""
        self._do("msbotProgram.run()")

    def stop(self) -> None:
        """See `Screen`."""
        self._do("msbotProgram.stop()")

    def _do(self, script: str) -> None:
        if not self._page.is_gone:
            with self._page.here():
                ui.run_javascript(script)

    def _follow(self) -> None:
        control, me = self._page.service.operations.pupils, self._page.session.name
        held, is_taken = control.held(me), control.taken_by(me) is not None
        if (held, is_taken) == self._shown:
            return
        self._shown = held, is_taken
        self._editor.set_enabled(not is_taken)
        for button in self._buttons:
            button.set_enabled(not is_taken)
        ui.run_javascript(f"document.querySelector('.ms-blocks-box')?.toggleAttribute('inert', {json.dumps(is_taken)})")
        ui.run_javascript(f"msbotProgram.hold({json.dumps(self._page.say(held) if held else '')})")
