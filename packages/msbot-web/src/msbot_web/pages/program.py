"""Writing a program and running it in this browser: an editor, a console, and the part that the program is.

The program runs in a worker of the browser (`static/program`); the server keeps it and is asked for nothing else.
"""

from __future__ import annotations

import json
from collections.abc import Awaitable
from typing import Any

from fastapi import Request
from nicegui import ui
from nicegui.events import GenericEventArguments

from msbot.operations.rights import Right
from msbot.registry import ProgramSource
from msbot_web.access.sessions import Session
from msbot_web.html import Markup, render
from msbot_web.models.robot_models import ChangeResult
from msbot_web.nicegui_internals.elements import DisableableElement
from msbot_web.pages.layout import BUILD_S, page_frame
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import menu_item, show_dialog
from msbot_web.pages.pilot import pilot_note
from msbot_web.pages.program_blocks import ProgramBlocks
from msbot_web.pages.program_editor import ShareDialog
from msbot_web.pages.program_words import program_words
from msbot_web.pages.pupil_program import TakenOverPage
from msbot_web.pages.waiting_parts import adopt
from msbot_web.programs.browser_files import examples
from msbot_web.programs.programs import MAX_BLOCKS, MAX_PROGRAM, ProgramActions
from msbot_web.programs.robot_words import PYTHON, with_view
from msbot_web.root_path import base_of, root
from msbot_web.service import Service
from msbot_xrce.errors import MsbotError

FIRST = "01_hello.py"
"""What is opened first in the sample robot, whose slots the numbered examples are for."""
PHONE = "phone.py"
"""The example that makes a part of the device itself."""
NEW = "00_blink.py"
"""What a new program begins with: it works in every robot, because it describes itself (docs/howto/add_a_part_type.md)."""
_MOST_MARKS = 20
_MOST_TYPED = 2 * (MAX_PROGRAM + MAX_BLOCKS)


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/program", response_timeout=BUILD_S)
    async def program(request: Request, name: str = "", shared: str = "") -> None:
        with page_frame(service, request, "/program", "Program") as page:
            if not page.may(Right.JOIN):
                ui.label(page.translate("Students and teachers may run programs."))
                return
            desk = _ProgramPage(page, base_of(request))
            await desk.lay_out(name, shared)


class _ProgramPage:
    """One person's editor and what stands around it."""

    def __init__(self, page: Page, base: str) -> None:
        self._page = page
        self._base = base
        self._deeds: ProgramActions = page.service.programs
        self._name = ""
        self._kept = ProgramSource("")
        """The program as it was opened or kept last."""
        self._blocks = ProgramBlocks(page, on_new=self._new_blocks)
        self._mine: list[str] = []
        self._was_connected = False
        self._is_guest = bool(page.session.guest_of)
        """Runs what the ticket opens, and keeps nothing."""

    async def lay_out(self, name: str, shared: str) -> None:
        """Make everything, and open what the address names: a program, a shared one, or the last."""
        from msbot_web.pages.program_editor import Editor  # with CodeMirror, which the first page does not need

        say = self._page.translate
        for script in ("board", "program"):
            ui.add_head_html(f'<script src="{root()}/web/program/{script}.js"></script>')
        pilot_note(self._page)
        bar = ui.element("div").classes("row w-full ms-prog-bar")
        self._blocks.lay_out()
        with bar:
            self._choice = ui.select([], label=say("Program"), on_change=self._chosen).props("dense outlined")
            self._choice.classes("ms-prog-choice").set_visibility(not self._is_guest)
            run = ui.button(say("Run"), icon="play_arrow", on_click=self._keep_if_changed).props("color=positive")
            run.on("click", js_handler="() => msbotProgram.run()")
            stop = ui.button(say("Stop"), icon="stop").props("outline").classes("ms-prog-stop")
            stop.on("click", js_handler="() => msbotProgram.stop()")
            self._blocks.lay_out_switch()
        with bar:
            keeping = () if self._is_guest else self._lay_out_keeping()
        with ui.element("div").classes("ms-prog ms-prog-guest" if self._is_guest else "ms-prog"):
            with ui.element("div").classes("ms-prog-left"):
                self._blocks.lay_out_place()
                # Until the page has been told which program it is: what was typed before it was loaded anew comes then,
                # and would take the place of what is typed earlier.
                with ui.element("div").classes("ms-prog-text").props("inert"):
                    self._editor = Editor("", language="Python").classes("ms-prog-editor")
                    self._editor.props("disable")  # until there is a program in it, which would replace what was typed
                    self._blocks.lay_out_note()
                ui.html(render("console", say=say), sanitize=False).classes("w-full ms-prog-console")
            ui.html(
                Markup(
                    render(
                        "program", say=say, words=json.dumps(program_words(say)), may_adopt=self._page.may(Right.DESIGN)
                    )
                ),
                sanitize=False,
            ).classes("ms-prog-right")
        ui.on("ms_program_line", self._mark)
        ui.on("ms_program_adopt", self._adopt)
        ui.on("ms_program_typed", self._typed)
        ui.run_javascript(f"msbotProgram.label({self._editor.id}, {json.dumps(say('Program text'))})")
        self._blocks.lay_out_editor(self._editor)
        held = (run, stop, self._blocks.switch, self._choice, *keeping)
        TakenOverPage(self._page, self._blocks, held, lambda: (self._name, self._source))
        assert self._page.client is not None
        self._page.client.on_disconnect(self._left)
        self._page.client.on_connect(self._connected)
        await self._list()
        await self._open_first(name, shared)

    def _lay_out_keeping(self) -> tuple[DisableableElement, ...]:
        """What belongs to a person's own programs; returns its buttons."""
        say = self._page.translate
        board = ui.button(say("Put on a board"), icon="usb", on_click=self._keep_if_changed).props("flat")
        board.on("click", js_handler="() => msbotProgram.showBoard()")
        keep = ui.button(say("Save"), icon="save", on_click=self._keep_now).props("flat")
        with ui.button(icon="more_vert").props(f'flat dense aria-label="{say("More")}"') as more, ui.menu():
            menu_item(say("New program"), self._new)
            menu_item(say("New program of blocks"), self._new_blocks)
            menu_item(say("Save as …"), self._keep_as)
            menu_item(say("Earlier versions"), self._versions)
            menu_item(say("Share, or open on a phone"), self._share)
            menu_item(say("A phone as a part"), self._phone)
            menu_item(say("Remove"), self._remove)
        return board, keep, more

    async def _open_first(self, name: str, shared: str) -> None:
        page = self._page
        if shared:
            try:
                owner, name, source = await self._deeds.shared(page.session, shared)
            except MsbotError as error:
                ui.notify(page.translate(str(error)), type="negative", timeout=10_000)
            else:
                await self._show(name, source)
                words = page.translate(
                    "A copy of {name} by {owner}. Read it before you run it.", name=name, owner=owner
                )
                ui.notify(words, timeout=10_000)
                return
        wanted = name or self._first()
        if wanted not in (*self._mine, *examples()):
            ui.notify(page.translate("There is no program {name}.", name=wanted), type="warning")
            wanted = self._first()
        await self._open(wanted)

    def _first(self) -> str:
        """The program that is opened unasked: the person's own, or an example that this robot has a place for."""
        if self._mine:
            return self._mine[0]
        entry = self._page.service.gallery.entry
        if entry is not None and entry.example:
            return entry.example
        return FIRST if f'robot="{self._page.service.robot_name}"' in examples()[FIRST] else NEW

    async def _list(self) -> None:
        """What can be chosen: the person's own programs first."""
        found = None if self._is_guest else await self._try(self._deeds.mine(self._page.session))
        self._mine = [program.name for program in found or ()]
        titles = {name: name for name in self._mine}
        titles |= {
            name: self._page.translate("{name} (example)", name=name) for name in examples() if name not in titles
        }
        self._choice.set_options(titles, value=self._name if self._name in titles else None)

    async def _chosen(self) -> None:
        name = str(self._choice.value or "")
        if name and name != self._name:
            await self._keep_if_changed()
            await self._open(name)

    async def _open(self, name: str) -> None:
        source = await self._try(self._deeds.source(self._page.session, name))
        if source is not None:
            await self._show(name, source)

    async def _show(self, name: str, source: ProgramSource) -> None:
        """Open a program as it is kept."""
        self._put_in(name, source.text)
        self._kept = source
        await self._blocks.opened(name, source)

    def _put_in(self, name: str, text: str) -> None:
        self._name = name
        self._editor.decorations = []
        self._editor.value = text
        if self._choice.value != name and name in (self._choice.options or ()):
            self._choice.value = name
        ui.run_javascript(
            f"msbotProgram.opened({self._editor.id}, {json.dumps(name)}, {json.dumps(self._page.session.name)});"
            f"history.replaceState(history.state, '', msbotAt({json.dumps(f'/program?name={name}')}))"
        )

    @property
    def _source(self) -> ProgramSource:
        """The program as it is now."""
        return ProgramSource(self._editor.value, self._blocks.doc)

    async def _keep_if_changed(self) -> None:
        if self._source != self._kept and not self._is_guest:
            await self._keep(self._name, quiet=True)

    async def _keep_now(self) -> None:
        await self._keep(self._name)

    async def _keep(self, name: str, *, quiet: bool = False) -> bool:
        source = self._source

        async def deed(session: Session) -> ChangeResult:
            number = await self._deeds.store(session, name, source)
            return ChangeResult(
                words=self._page.translate("{name} is saved, version {number}.", name=name, number=number)
            )

        if await self._page.do(deed, quiet=quiet) is None:
            return False
        self._kept, self._name = source, name
        if name not in self._mine:
            await self._list()
        return True

    async def _left(self) -> None:
        """The page is closed: what was typed is not lost."""
        if self._source != self._kept and not self._is_guest:
            source = self._source
            try:
                await self._deeds.store(self._page.session, self._name, source)
            except MsbotError:
                return  # signed out, or too long: the person was told when it was kept or run
            self._kept = source

    def _connected(self) -> None:
        """The connection is there; if it was there before, what was under way when it broke may be lost."""
        if self._was_connected:
            ui.run_javascript("msbotProgram.tellAll()")
        self._was_connected = True

    async def _typed(self, event: GenericEventArguments) -> None:
        """Take what was typed into the page that was here before; `event.args` comes from the browser."""
        found = event.args if isinstance(event.args, dict) else {}
        text, blocks = found.get("text"), found.get("blocks")
        if (found.get("name"), found.get("who")) != (self._name, self._page.session.name):
            return
        # What is too long to be kept is told so when it is kept (`check_program`).
        if not isinstance(text, str) or not isinstance(blocks, str) or len(text) + len(blocks) > _MOST_TYPED:
            return
        if not blocks and text != self._editor.value:  # it was shown as text, also if its blocks had made it before
            blocks = with_view(self._blocks.doc, PYTHON)
        source = ProgramSource(text, blocks or self._blocks.doc)
        if source == self._source or not self._editor.enabled:
            return
        self._put_in(self._name, text)
        await self._blocks.opened(self._name, source)
        if found.get("isAway"):
            ui.notify(self._page.translate("What you typed while the robot was out of reach is here again."))

    def _mark(self, event: GenericEventArguments) -> None:
        """Mark the lines that an error names; `event.args` comes from the browser."""
        lines, most = _lines_of(event.args), self._editor.value.count("\n") + 1
        lines = [line for line in lines if line <= most]
        known = [spec["line"] for spec in self._editor.decorations]
        wanted = sorted({*known, *lines}) if lines else []
        self._editor.decorations = [
            {"kind": "line", "line": line, "class": "ms-wrong-line"} for line in wanted[:_MOST_MARKS]
        ]
        if lines:
            self._editor.reveal_line(lines[0])

    async def _adopt(self, event: GenericEventArguments) -> None:
        """Adopt the part that runs in this browser; `event.args` comes from there, and the right is checked again."""
        uid = event.args.get("uid") if isinstance(event.args, dict) else None
        if isinstance(uid, str):
            await adopt(self._page, uid)

    # The menu.

    async def _new(self) -> None:
        await self._keep_if_changed()
        await self._show(self._free_name("program"), ProgramSource(examples()[NEW]))
        await self._keep(self._name, quiet=True)
        self._choice.value = self._name

    async def _new_blocks(self) -> None:
        """A program that begins with blocks; the one that was open is kept."""
        await self._keep_if_changed()
        before = self._name
        self._put_in(self._free_name("blocks"), "")
        self._kept = ProgramSource("")
        await self._blocks.begin(self._name)
        await self._keep_if_changed()
        self._choice.value = self._name
        ui.notify(
            self._page.translate(
                "{name} is a new program of blocks; {before} stays as it is.", name=self._name, before=before
            )
        )

    def _free_name(self, word: str) -> str:
        number = 1
        while f"{word}{number}.py" in self._mine:
            number += 1
        return f"{word}{number}.py"

    def _keep_as(self) -> None:
        say = self._page.translate
        with ui.dialog() as dialog, ui.card():
            field = ui.input(say("Name"), value=self._name).props("outlined autofocus")

            async def keep() -> None:
                name = str(field.value or "").strip()
                name = name if name.endswith(".py") else f"{name}.py"
                if await self._keep(name):
                    dialog.close()
                    self._put_in(name, self._editor.value)
                    self._blocks.renamed(name)

            ui.button(say("Save"), on_click=keep)
        show_dialog(dialog)

    async def _versions(self) -> None:
        page = self._page
        found = await self._try(self._deeds.versions(page.session, self._name))
        if found is None:
            return
        with ui.dialog() as dialog, ui.card():
            ui.label(page.translate("Earlier versions of {name}", name=self._name)).props("role=heading aria-level=2")
            for version in found:

                async def back(number: int = version.number) -> None:
                    source = await self._try(self._deeds.source(page.session, self._name, number))
                    if source is not None:
                        dialog.close()
                        kept = self._kept
                        await self._show(self._name, source)
                        self._kept = kept  # of the newest version: this one becomes the next when it is kept

                when = page.when(version.saved_ns // 1_000_000)
                words = page.translate(
                    "{number}: {when}, {size} characters", number=version.number, when=when, size=version.size
                )
                ui.button(words, on_click=back).props("flat no-caps align=left")
        show_dialog(dialog)

    async def _share(self) -> None:
        is_example = self._name in examples() and self._name not in self._mine and self._source == self._kept
        if is_example or await self._keep(self._name, quiet=True):
            await ShareDialog(self._page, self._base, self._name, is_example=is_example).show()

    async def _phone(self) -> None:
        await ShareDialog(self._page, self._base, PHONE, is_example=PHONE not in self._mine).show()

    def _remove(self) -> None:
        page = self._page
        with ui.dialog() as dialog, ui.card():
            ui.label(page.translate("Remove {name} with all its versions?", name=self._name))

            async def remove() -> None:
                async def deed(session: Session) -> ChangeResult:
                    await self._deeds.remove(session, self._name)
                    return ChangeResult(words=page.translate("{name} is removed.", name=self._name))

                dialog.close()
                if await page.do(deed) is not None:
                    self._kept = self._source
                    await self._list()
                    await self._open(self._first())

            with ui.element("div").classes("row"):
                ui.button(page.translate("Yes"), on_click=remove).props("color=negative")
                ui.button(page.translate("Cancel"), on_click=dialog.close).props("flat")
        show_dialog(dialog)

    async def _try(self, asked: Awaitable[Any]) -> Any:  # noqa: ANN401 - whatever was asked for
        """The answer, or None when there is none, and the person has been told why."""
        try:
            return await asked
        except MsbotError as error:
            ui.notify(self._page.translate(str(error)), type="negative", multi_line=True, timeout=10_000)
            return None


def _lines_of(args: Any) -> list[int]:  # noqa: ANN401 - anything can come from a browser
    if not isinstance(args, dict):
        return []
    lines = args.get("lines")
    return [line for line in lines[:_MOST_MARKS] if type(line) is int and line > 0] if isinstance(lines, list) else []
