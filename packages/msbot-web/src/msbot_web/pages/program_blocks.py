"""Blocks on the page Program: the switch Blocks | Python, and the blocks of the program that is open.

What blocks mean as Python is worked out in the browser (`static/program/blocks.js`) and goes into the editor as if it
was typed; here are the blocks themselves, as one text that is kept with the program, and what the robot has for them.
"""

from __future__ import annotations

import json
from collections.abc import Awaitable, Callable
from importlib.resources import files

from nicegui import ui
from nicegui.events import GenericEventArguments, ValueChangeEventArguments

from msbot.registry import ProgramSource
from msbot_web.html import Markup, render
from msbot_web.language import ENGLISH
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import show_dialog
from msbot_web.programs.programs import MAX_BLOCKS
from msbot_web.programs.robot_words import BLOCKS, PYTHON, RobotWords, View, robot_words, view_of, with_view
from msbot_web.root_path import root

_ANSWER_S = 30.0
"""So long a browser may take to load Blockly; it is 850 kB from the robot's computer, once."""
_LOOKS = 4
"""The robot is looked at anew each so many looks of the page."""


class ProgramBlocks:
    """See the module's docstring.

    Args:
        page: whose.
        on_new: makes a new program of blocks, because the one that is open has never had any.
    """

    def __init__(self, page: Page, *, on_new: Callable[[], Awaitable[None]]) -> None:
        self._page = page
        self._on_new = on_new
        self._name = ""
        self._view: View = PYTHON
        self._told = ""
        self._looks = 0
        self._is_setting = False
        self.doc = ""
        """The blocks of the program that is open, as they are kept; empty: it has none."""

    def lay_out_switch(self) -> None:
        """The two buttons."""
        say = self._page.translate
        views = {BLOCKS: say("Blocks"), PYTHON: say("Python")}
        self.switch = ui.toggle(views, value=PYTHON, on_change=self._switched)
        # In the browser a view is its number. Blocks that stay until the answer comes would take keys, and write over
        # what is typed.
        python = list(views).index(PYTHON)
        self.switch.on("update:model-value", js_handler=f"(number) => number === {python} && msbotBlocks.hide()")
        self.switch.props(f'no-caps aria-label="{say("Blocks or Python")}"').classes("ms-blocks-switch")

    def lay_out_note(self) -> None:
        """One line that says what the text is."""
        self._note = ui.label().classes("soft ms-blocks-note").props("role=status")

    def lay_out(self) -> None:
        """The script; it loads the rest when somebody wants blocks."""
        ui.add_head_html(f'<script src="{root()}/web/program/blocks.js"></script>')
        ui.on("ms_blocks", self._heard)

    def lay_out_place(self) -> None:
        """Where the blocks are."""
        ui.html(Markup(render("blocks", say=self._page.translate)), sanitize=False).classes("w-full ms-blocks-box")

    def lay_out_editor(self, editor: ui.codemirror) -> None:
        """The editor that holds the Python."""
        code = self._page.language.code
        self._editor = editor
        ui.run_javascript(
            f"msbotBlocks.use({editor.id}, {json.dumps(block_words(self._page.translate))}, "
            f"{json.dumps(code if _has_blockly(code) else ENGLISH)})"
        )
        self._tell_robot()
        self._page.every_look(self._look)

    async def opened(self, name: str, source: ProgramSource) -> None:
        """Another program is open now: show it as it was kept."""
        self._name, self.doc = name, source.blocks
        if view_of(source.blocks) is BLOCKS:
            await self._show_blocks()
        else:
            self._show_python()

    async def begin(self, name: str) -> None:
        """A new program, made of blocks."""
        self._name, self.doc = name, ""
        await self._show_blocks()

    def renamed(self, name: str) -> None:
        """The program that is open has another name now."""
        self._name = name
        if self._view is BLOCKS:
            ui.run_javascript(f"msbotBlocks.rename({json.dumps(name)})")

    def put_text(self, text: str) -> None:
        """Somebody else has written this program: it is text now, and its blocks are kept."""
        if self._view is BLOCKS:
            self.doc = with_view(self.doc, PYTHON)
            self._show_python()
        self._editor.value = text

    def lock(self, *, is_locked: bool) -> None:
        """Let nothing be typed or moved, and hear nothing of it, or let it again."""
        self._editor.set_enabled(not is_locked)
        self._set_writable()
        ui.run_javascript(f"document.querySelector('.ms-blocks-box').toggleAttribute('inert', {json.dumps(is_locked)})")

    # The switch.

    async def _switched(self, event: ValueChangeEventArguments[View]) -> None:
        if self._is_setting or event.value == self._view:
            return
        if event.value == PYTHON:
            self.doc = with_view(self.doc, PYTHON)
            self._show_python()
            ui.notify(
                self._page.translate("From here on it is text. The blocks are kept; text does not turn into blocks.")
            )
        elif not self.doc:
            await self._on_new()
        else:
            await self._back_to_blocks()

    async def _back_to_blocks(self) -> None:
        """The blocks as they were kept; what has been written since is not in them."""
        page, name = self._page, self._name
        answer = await self._ask(f"msbotBlocks.textOf({json.dumps(self.doc)})")
        if not isinstance(answer, dict) or name != self._name:
            self._set_switch()
            return
        if answer.get("text") == self._editor.value:
            await self._show_blocks()
            return
        if answer.get("error"):
            self._refused(str(answer["error"]))
            return
        with ui.dialog() as dialog, ui.card():
            ui.label(page.translate("The text has been changed since it was made of blocks.")).props(
                "role=heading aria-level=2"
            )
            ui.label(
                page.translate(
                    "The blocks do not know of it: text does not turn into blocks. The text stays under Earlier versions."
                )
            )

            async def back() -> None:
                dialog.close()
                await self._show_blocks()

            with ui.element("div").classes("row"):
                ui.button(page.translate("Back to the blocks"), on_click=back)
                ui.button(page.translate("Stay with the text"), on_click=dialog.close).props("flat")
        self._set_switch()
        show_dialog(dialog)

    async def _show_blocks(self) -> None:
        name, self._view = self._name, BLOCKS
        self._tell_robot()
        answer = await self._ask(
            f"msbotBlocks.show({', '.join(map(json.dumps, (name, self.doc, self._editor.value)))})"
        )
        if name != self._name or self._view is not BLOCKS:  # another one, or a teacher has written into it meanwhile
            return
        if isinstance(answer, dict):
            self._refused(self._page.translate("The text has been changed since it was made of blocks."))
            return
        if answer is None or answer:
            self._refused(str(answer or ""))
            return
        self._set_writable()
        self._editor.set_line_wrapping(True)  # it is narrow beside the blocks
        self._note.text = self._page.translate("This Python is made of the blocks, while you move them.")
        self._set_switch()

    def _show_python(self) -> None:
        self._view = PYTHON
        ui.run_javascript("msbotBlocks.hide()")
        self._set_writable()
        self._editor.set_line_wrapping(False)
        self._note.text = (
            self._page.translate(
                "Text does not turn into blocks. The blocks are kept as they were: Blocks leads back to them."
            )
            if self.doc
            else ""
        )
        self._set_switch()

    def _set_writable(self) -> None:
        """Text is typed where it is not made of blocks, and nobody else has the program."""
        if self._view is PYTHON and self._editor.enabled:
            self._editor.props(remove="disable")
        else:  # not disable() for blocks: then what they write into it would not be heard either
            self._editor.props("disable")

    def _refused(self, error: str) -> None:
        """The blocks cannot be shown; the text is there, and so are they."""
        self._show_python()
        if error:
            ui.notify(
                error, type="warning", multi_line=True, timeout=10_000, close_button=self._page.translate("Close")
            )

    def _set_switch(self) -> None:
        self._is_setting = True
        self.switch.value = self._view
        self._is_setting = False

    async def _ask(self, code: str) -> object:
        """What the browser answers; None when it is gone."""
        client = self._page.client
        assert client is not None
        try:
            await client.connected(timeout=_ANSWER_S)
            answer: object = await ui.run_javascript(code, timeout=_ANSWER_S)
        except TimeoutError:
            return None
        return answer

    # What comes and goes.

    def _heard(self, event: GenericEventArguments) -> None:
        """Blocks have been moved; `event.args` comes from the browser."""
        args = event.args if isinstance(event.args, dict) else {}
        doc = args.get("doc")
        if args.get("name") != self._name or not isinstance(doc, str) or self._view is not BLOCKS:
            return
        # One that is too long is kept from being kept, with a sentence (`check_program`); twice of that is no program.
        if len(doc) <= 2 * MAX_BLOCKS:
            self.doc = doc

    def _look(self) -> None:
        self._looks += 1
        if self._view is BLOCKS and self._looks % _LOOKS == 0:
            self._tell_robot()

    def _tell_robot(self) -> None:
        """Let the browser know what the robot has, when that has changed."""
        told = json.dumps(self._robot())
        if told != self._told:
            self._told = told
            ui.run_javascript(f"msbotBlocks.know({told})")

    def _robot(self) -> RobotWords:
        service = self._page.service
        return robot_words(service.robot().slots, service.views.ports(), service.views.library, self._page.translate)


def _has_blockly(code: str) -> bool:
    """Whether Blockly's own words of a language are carried; the blocks' words are in the catalogue."""
    return (files("msbot_web") / "static" / "blockly" / f"{code}.js").is_file()


def block_words(say: Callable[[str], str]) -> dict[str, str]:
    """What blocks and their script say, in the person's language; %1 and so on are the fields and inputs of a block."""
    return {
        "part": say("this program is the part %1"),
        "own": say("a part of its own"),
        "ownPart": say("part number %1 which is a %2"),
        "ownTitle": say("light that blinks"),
        "ownPort": say("%1 %2 at its port %3"),
        "sends": say("it sends"),
        "receives": say("it receives"),
        "ownPortName": say("light"),
        "when": say("when a message arrives at %1"),
        "every": say("every %1 seconds"),
        "event": say("when %1"),
        "event_join": say("the part has joined"),
        "event_stop": say("STOP is said"),
        "event_go": say("GO is said"),
        "event_identify": say("somebody asks which part it is"),
        "event_lost": say("the robot is lost"),
        "send": say("send to %1"),
        "setting": say("setting %1"),
        "stopped": say("STOP holds"),
        "bound": say("the robot uses %1"),
        "wait": say("wait %1 seconds"),
        "forever": say("repeat forever"),
        "end": say("end the program"),
        "hello": say("hello"),
        "inPorts": say("Ports"),
        "inWhen": say("When"),
        "inSend": say("Send"),
        "inSense": say("Sense"),
        "inLoops": say("Repeat"),
        "inLogic": say("If"),
        "inMath": say("Numbers"),
        "inText": say("Words"),
        "inVariables": say("Variables"),
        "unwired": say("not wired"),
        "missing": say("missing"),
        "unused": say("not part of the program"),
        "oneRoot": say("A program is one part: only the first of these blocks counts."),
        "nothing": say("This robot has nothing for this block."),
        "noPart": say("This robot has no slot for {port} (any more). Choose another part; nothing is lost."),
        "noPort": say("The part {number} has no {port} here (any more). Choose another one; nothing is lost."),
        "notWired": say("The robot does not wire {port}: nothing arrives or leaves."),
        "silent": say("Nobody sends to {port} now: no part is in the slot {slot}."),
        "block": say("the block"),
        "tooLarge": say("The blocks of this program are too many to be shown; its Python is here."),
        "broken": say("The blocks of this program are broken and cannot be shown; its Python is here."),
        "newer": say("The blocks of this program are of a newer MsBOT and cannot be shown; its Python is here."),
        "noFiles": say("The robot's computer does not answer: the blocks cannot be loaded."),
    }
