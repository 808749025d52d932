"""A pupil's program, for the teacher: to look at while it is being typed, to take over, to hand back."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence

from fastapi import Request
from nicegui import ui

from msbot.operations.rights import Right
from msbot.registry import ProgramSource
from msbot_web.access.sessions import Session
from msbot_web.models.robot_models import ChangeResult
from msbot_web.nicegui_internals.elements import DisableableElement
from msbot_web.pages.layout import page_frame
from msbot_web.pages.page import Page
from msbot_web.pages.program_blocks import ProgramBlocks
from msbot_web.service import Service
from msbot_xrce.errors import MsbotError


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/pupil")
    def pupil(request: Request, name: str = "") -> None:
        with page_frame(service, request, "/pupils", "A pupil's program") as page:
            if not page.may(Right.ARRANGE):
                ui.label(page.translate("Only a teacher sees this page.")).classes("ms-banner warn")
                return
            _PupilProgramView(page, name)


class _PupilProgramView:
    """One pupil's program."""

    def __init__(self, page: Page, pupil: str) -> None:
        from msbot_web.pages.program_editor import Editor  # with CodeMirror, which the first page does not need

        self._page = page
        self._pupil = pupil
        self._name = ""
        """Of the program."""
        self._seen: str | None = None
        """Its text, as it was read or shown to the pupil last; None: not yet."""
        self._kept = ""
        """Its text, as the pupil has it or as it was kept for the pupil last."""
        say = page.translate
        ui.link(say("Back to the pupils"), "/pupils")
        with ui.element("div").classes("row spread w-full"):
            self._title = ui.label(pupil).classes("ms-pupil-name").style("font-weight:600;font-size:1.2rem")
            with ui.element("div").classes("row"):
                self._take = ui.button(say("Take over"), icon="front_hand", on_click=self._take_over)
                self._run = ui.button(say("Run"), icon="play_arrow", on_click=self._start).props("color=positive")
                self._hold = ui.button(say("Stop"), icon="stop", on_click=self._end).props("outline")
                self._back = ui.button(say("Hand back"), icon="undo", on_click=self._hand_back).props("outline")
        self._state = ui.label("").classes("soft").props("role=status")
        self._editor = Editor("", language="Python").classes("ms-prog-editor w-full")
        self._editor.set_enabled(False)
        page.every_look(self._look)

    @property
    def _is_mine(self) -> bool:
        taken = self._page.service.operations.pupils.taken_by(self._pupil)
        return taken is not None and taken.by == self._page.session.name

    async def _look(self) -> None:
        page, say, mine = self._page, self._page.translate, self._is_mine
        self._take.set_visibility(not mine)
        for button in (self._run, self._hold, self._back):
            button.set_visibility(mine)
        if self._editor.enabled is not mine:
            self._editor.set_enabled(mine)
        try:
            name, source, is_open = await page.service.pupils.program(page.session, self._pupil)
            if mine and self._seen is not None:
                self._show()
        except MsbotError as error:
            self._state.set_text(say(str(error)))
            return
        self._title.set_text(f"{self._pupil} · {name}")
        taken = page.service.operations.pupils.taken_by(self._pupil)
        words = say("as it is being typed") if is_open else say("as it was kept last: the page is not open")
        if mine:
            words = say("You have this program: what you write is shown to the pupil.")
        elif taken is not None:
            words = say("taken over by {by}", by=taken.by)
        self._state.set_text(words)
        if not mine or self._seen is None:
            self._name = name
            if source.text != self._seen:
                self._editor.value = self._seen = self._kept = source.text

    def _show(self) -> None:
        """Let the pupil see what is written here."""
        text = str(self._editor.value or "")
        if text != self._seen:
            self._page.service.pupils.show(self._page.session, self._pupil, self._name, text)
            self._seen = text

    async def _take_over(self) -> None:
        page = self._page
        await self._look()
        if await page.act("take_over", pupil=self._pupil) is not None:
            await page.do(lambda session: page.service.pupils.keep_as_it_is(session, self._pupil), quiet=True)

    async def _hand_back(self) -> None:
        await self._write()
        await self._page.act("hand_back", pupil=self._pupil)

    async def _write(self) -> bool:
        """Keep for the pupil what is written here, if that is something else."""
        page, text = self._page, str(self._editor.value or "")
        if text == self._kept:
            return True
        done = await page.do(
            lambda session: page.service.pupils.write(session, self._pupil, self._name, text), quiet=True
        )
        if done is None:
            return False
        self._seen = self._kept = text
        return True

    async def _start(self) -> None:
        if (
            await self._write()
            and await self._page.act("take_over", quiet=True, pupil=self._pupil, run=True) is not None
        ):
            await self._steer(run=True)

    async def _end(self) -> None:
        await self._page.act("take_over", quiet=True, pupil=self._pupil)
        await self._steer(run=False)

    async def _steer(self, *, run: bool) -> None:
        page = self._page

        def deed(session: Session) -> ChangeResult:
            page.service.pupils.steer(session, self._pupil, run=run)
            say, name = page.translate, self._pupil
            if run:
                return ChangeResult(words=say("The program runs in the browser of {name}.", name=name))
            return ChangeResult(words=say("The program of {name} has ended.", name=name))

        await page.do(deed)


# The page Program of a pupil, as a teacher may look at it, hold it and take it over.


class TakenOverPage:
    """One open page; a `ProgramScreen` for whoever has taken it over.

    Args:
        page: the page.
        blocks: its text and blocks; the program is text as soon as the teacher has written something else.
        buttons: what the pupil cannot press while a teacher has the program.
        program: name and source of the program that is open, as it is now.
    """

    def __init__(
        self,
        page: Page,
        blocks: ProgramBlocks,
        buttons: Sequence[DisableableElement],
        program: Callable[[], tuple[str, ProgramSource]],
    ) -> None:
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
        """See `ProgramScreen`."""
        return self._program()

    def show(self, text: str) -> None:
        """See `ProgramScreen`."""
        with self._page.in_page():
            self._blocks.put_text(text)

    def run(self) -> None:
        """See `ProgramScreen`."""
        self._do("msbotProgram.run()")

    def stop(self) -> None:
        """See `ProgramScreen`."""
        self._do("msbotProgram.stop()")

    def _do(self, script: str) -> None:
        if not self._page.is_gone:
            with self._page.in_page():
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
        ui.run_javascript(f"msbotProgram.hold({json.dumps(self._page.translate(held) if held else '')})")
