"""The page Program of a pupil, as a teacher may look at it, hold it and take it over."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence

from nicegui import ui

from msbot.operations.rights import Right
from msbot.registry import ProgramSource
from msbot_web.nicegui_internals.elements import DisableableElement
from msbot_web.pages.layout import Page
from msbot_web.pages.program_blocks import ProgramBlocks


class UnderTeacher:
    """One open page; a `Screen` for whoever has taken it over.

    Args:
        page: the page.
        blocks: its text and blocks; the program is text as soon as the teacher has written something else.
        buttons: what the pupil cannot press while a teacher has the program.
        program: name and source of the program that is open, as it is now.
    """

    def __init__(
        self, page: Page, blocks: ProgramBlocks, buttons: Sequence[DisableableElement],
        program: Callable[[], tuple[str, ProgramSource]],
    ) -> None:  # fmt: skip
        self._page = page
        self._blocks = blocks
        self._buttons = buttons
        self._program = program
        self._shown: tuple[str, bool] = ("", False)
        if page.may(Right.ARRANGE) or page.client is None:
            return
        page.client.on_delete(page.service.pupils.opened(page.session.name, self))
        page.every_look(self._follow)

    def program(self) -> tuple[str, ProgramSource]:
        """See `Screen`."""
        return self._program()

    def show(self, text: str) -> None:
        """See `Screen`."""
        with self._page.here():
            self._blocks.put_text(text)

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
        self._blocks.lock(is_locked=is_taken)
        for button in self._buttons:
            button.set_enabled(not is_taken)
        ui.run_javascript(f"msbotProgram.hold({json.dumps(self._page.say(held) if held else '')})")
