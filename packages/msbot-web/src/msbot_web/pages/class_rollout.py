"""One blueprint for many robots, on the page Class: choose, see what would change, begin, watch, take back."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence

from nicegui import ui
from nicegui.events import UploadEventArguments

from msbot_school.classroom.rollout import RollOutPlan
from msbot_school.classroom.rollout_run import RobotStep, RollOutEntry, RollOutRun, StepState
from msbot_web.class_rollouts import ChosenBlueprint, RobotKey
from msbot_web.html import render
from msbot_web.models.class_models import RobotTile
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import ask_first, file_button, heading, panel, set_html
from msbot_web.service import MAX_BLUEPRINT
from msbot_xrce.errors import MsbotError

MOST_CHANGES = 6
"""Changes of a robot that are named before a roll-out."""
_LOOKS = {
    StepState.WAITING: ("empty", "○"),
    StepState.WORKING: ("late", "◐"),
    StepState.CHANGED: ("active", "●"),
    StepState.REFUSED: ("lost", "✕"),
    StepState.SILENT: ("lost", "?"),
    StepState.LEFT: ("empty", "–"),
}
"""Colour and sign."""


class RollOutPanel:
    """See the module's docstring.

    Args:
        page: where.
        shown: the robots that the search shows at the moment.
    """

    def __init__(self, page: Page, shown: Callable[[], Sequence[RobotTile]]) -> None:
        self._page = page
        self._shown = shown
        self._doing = page.service.whole_class.rollouts
        self._pattern: ChosenBlueprint | None = None
        self._plans: list[RollOutPlan] = []
        self._ticks: dict[RobotKey, ui.checkbox] = {}
        self._keys: list[RobotKey] = []
        """Of the robots whose blueprint can be chosen."""
        self._remembered: RollOutEntry | None = None
        say = page.translate
        self.button = ui.button(say("One blueprint for many"), icon="dynamic_feed", on_click=self._turn).props(
            "outline"
        )
        self._panel = panel().classes("w-full")
        self._panel.set_visibility(False)
        with self._panel:
            heading(say("One blueprint for many"))
            ui.label(
                say(
                    "Each robot keeps its own name, serial number, version and maker. You see what would change before "
                    "anything is changed, and can take it all back."
                )
            ).classes("soft")
            self._choosing = ui.column().classes("w-full").style("gap:.6rem")
            with self._choosing:
                self._choose()
            self._running = ui.column().classes("w-full").style("gap:.4rem;margin-top:.6rem")
            with self._running:
                self._watch()
        page.every_look(self._look)

    def _turn(self) -> None:
        is_open = not self._panel.visible
        self._panel.set_visibility(is_open)
        self.button.props(f"aria-expanded={'true' if is_open else 'false'}")
        if is_open:
            self._take_shown()

    # Choose

    def _choose(self) -> None:
        say = self._page.translate
        with ui.element("div").classes("row"):
            self._of = (
                ui.select({}, label=say("Blueprint of the robot"), on_change=self._take_robot)
                .props("dense outlined")
                .style("min-width:min(16rem,100%)")
            )
            file_button(
                self._page, say("Blueprint from a file"), self._take_file, max_size=MAX_BLUEPRINT, ending=".toml"
            )
        self._source = ui.label(say("No blueprint is chosen yet.")).props("aria-live=polite")
        with ui.element("fieldset").classes("w-full").style("border:1px solid var(--line);border-radius:10px"):
            with ui.element("legend"):
                ui.label(say("Which robots"))
            with ui.element("div").classes("row"):
                ui.button(say("All that the search shows"), on_click=self._take_shown).props("flat dense")
                ui.button(say("None"), on_click=self._untick).props("flat dense")
            self._robots = ui.element("div").classes("row")
        with ui.element("div").classes("row"):
            self._compare_button = ui.button(say("Show what would change"), icon="difference", on_click=self._compare)
            self._compare_button.props("outline")
            self._begin_button = ui.button(say("Begin"), icon="play_arrow", on_click=self._ask)
        self._result = ui.html("", sanitize=False).classes("w-full").props("aria-live=polite")
        self._forget_plans()

    def _take_shown(self) -> None:
        self._forget_plans()
        tiles = self._shown()
        self._robots.clear()
        keys = [(tile.name, tile.serial_number, tile.database) for tile in tiles]
        with self._robots:
            self._ticks = {
                key: ui.checkbox(f"{key[0]} {key[1]}", value=True, on_change=self._forget_plans) for key in keys
            }
        names = {number: f"{tile.name} {tile.serial_number}" for number, tile in enumerate(tiles)}
        self._keys = keys
        self._of.set_options(names, value=None)

    def _untick(self) -> None:
        for tick in self._ticks.values():
            tick.set_value(False)

    def _forget_plans(self) -> None:
        self._plans = []
        self._result.set_content("")
        self._begin_button.set_enabled(False)

    async def _take_robot(self) -> None:
        if self._of.value is None:
            return
        key, service = self._keys[self._of.value], self._doing
        await self._take(lambda: service.pattern_of(self._page.session, key))

    async def _take_file(self, event: UploadEventArguments) -> None:
        page, name = self._page, event.file.name
        try:
            toml = (await event.file.read()).decode("utf-8")
        except UnicodeDecodeError:
            ui.notify(page.translate("This file is not UTF-8 text."), type="negative")
            return
        self._of.set_value(None)
        await self._take(lambda: self._doing.pattern(page.session, name, toml))

    async def _take(self, read: Callable[[], Awaitable[ChosenBlueprint]]) -> None:
        self._forget_plans()
        self._pattern = None
        try:
            self._pattern = await read()
        except MsbotError as error:
            self._source.set_text(self._page.translate("No blueprint is chosen yet."))
            self._fail(error)
            return
        self._source.set_text(self._page.translate("Blueprint: {source}", source=self._pattern.source))

    def _fail(self, error: MsbotError) -> None:
        say = self._page.translate
        self._result.set_content(render("changes", say=say, error=say(str(error)), changes=[]))

    # Compare and begin

    async def _compare(self) -> None:
        page = self._page
        self._forget_plans()
        if self._pattern is None:
            ui.notify(page.translate("Choose a blueprint first: of a robot, or from a file."), type="warning")
            return
        chosen = [key for key, tick in self._ticks.items() if tick.value]
        if not chosen:
            ui.notify(page.translate("Tick at least one robot."), type="warning")
            return
        self._compare_button.props("loading")
        try:
            plans = await self._doing.plan(page.session, self._pattern, chosen)
        except MsbotError as error:
            self._fail(error)
            return
        finally:
            self._compare_button.props(remove="loading")
        self._plans = plans
        set_html(self._result, render("rollout_plan", say=page.translate, plans=plans, most=MOST_CHANGES))
        self._begin_button.set_enabled(any(plan.changes for plan in plans))

    async def _ask(self) -> None:
        pattern, plans = self._pattern, self._plans
        if pattern is None or not plans:
            return
        page, count = self._page, sum(bool(plan.changes) for plan in plans)

        async def begin() -> None:
            await self._do(lambda: self._doing.begin(page.session, pattern, plans))

        ask_first(
            page,
            page.language.count(
                count,
                "Put the blueprint {source} into force in {count} robot?",
                "Put the blueprint {source} into force in {count} robots?",
                source=pattern.source,
            ),
            begin,
        )

    async def _do(self, deed: Callable[[], Awaitable[RollOutRun]]) -> None:
        page = self._page
        try:
            await deed()
        except MsbotError as error:
            ui.notify(page.translate(str(error)), type="negative", multi_line=True, timeout=10_000)
            return
        self._forget_plans()
        page.refresh()

    # Watch and take back

    def _watch(self) -> None:
        say = self._page.translate
        self._sum = ui.label("").props("aria-live=polite").style("font-weight:600")
        self._steps = ui.html("", sanitize=False).classes("w-full")
        with ui.element("div").classes("row"):
            self._halt_button = ui.button(say("Change no further robot"), icon="pause", on_click=self._halt)
            self._halt_button.props("outline")
            self._undo_button = ui.button(say("Take it back"), icon="undo", on_click=self._ask_undo).props("outline")

    async def _look(self) -> None:
        if not self._panel.visible:
            return
        page, run = self._page, self._doing.run
        is_on = run is not None and not run.is_over
        self._remembered = None if is_on else await self._doing.last(page.session)
        self._halt_button.set_visibility(is_on)
        self._undo_button.set_visibility(self._remembered is not None)
        if run is not None:
            steps = run.steps
            self._sum.set_text(self._sum_of(run, steps))
            shown = [(step, *_LOOKS[step.state], self._word(run, step)) for step in steps]
            set_html(self._steps, render("rollout_run", say=page.translate, steps=shown))
        elif self._remembered is not None:
            self._sum.set_text(self._words_of(self._remembered))
        self._running.set_visibility(run is not None or self._remembered is not None)

    def _sum_of(self, run: RollOutRun, steps: Sequence[RobotStep]) -> str:
        count = self._page.language.count
        done = sum(step.state is StepState.CHANGED for step in steps)
        left = sum(step.state in (StepState.WAITING, StepState.WORKING) for step in steps)
        values = {
            "source": run.blueprint,
            "done": done,
            "left": left,
            "failed": len(steps) - done - left,
        }
        if run.is_undo:
            return count(
                len(steps),
                "{source}, taken back: {done} of {count} robot; {left} to go, {failed} not",
                "{source}, taken back: {done} of {count} robots; {left} to go, {failed} not",
                **values,
            )
        return count(
            len(steps),
            "{source}, rolled out: {done} of {count} robot; {left} to go, {failed} not",
            "{source}, rolled out: {done} of {count} robots; {left} to go, {failed} not",
            **values,
        )

    def _word(self, run: RollOutRun, step: RobotStep) -> str:
        say = self._page.translate
        match step.state:
            case StepState.CHANGED if step.edit is not None:
                return say("taken back, edit {edit}" if run.is_undo else "changed, edit {edit}", edit=step.edit)
            case StepState.CHANGED:
                return say("taken back" if run.is_undo else "nothing to change")
            case StepState.SILENT:
                return say("no answer: NOT changed, as far as is known")
            case StepState.REFUSED:
                return say("refused")
            case StepState.WORKING:
                return say("being changed")
            case StepState.LEFT:
                return say("left as it is")
        return say("waiting")

    def _halt(self) -> None:
        page = self._page
        try:
            self._doing.halt(page.session)
        except MsbotError as error:
            ui.notify(page.translate(str(error)), type="negative", multi_line=True)
        page.refresh()

    def _words_of(self, remembered: RollOutEntry) -> str:
        when = self._page.when(round(remembered.at * 1000))
        return self._page.language.count(
            len(remembered.done),
            "{source}, rolled out on {when} to {count} robot",
            "{source}, rolled out on {when} to {count} robots",
            source=remembered.blueprint,
            when=when,
        )

    async def _ask_undo(self) -> None:
        remembered, page = self._remembered, self._page
        if remembered is None:
            return

        async def undo() -> None:
            await self._do(lambda: self._doing.undo(page.session, remembered))

        ask_first(page, page.translate("Take this back? {what}", what=self._words_of(remembered)), undo)
