"""Missions on the page: what is to be found, answers, repairs and hints; a teacher starts and stops; the reports."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from pathlib import PurePath

from fastapi import Request
from nicegui import ui
from nicegui.events import UploadEventArguments

from msbot.operations.rights import Right
from msbot_school.faults.fault_kinds import KINDS
from msbot_school.missions.mission import REPAIRS
from msbot_school.missions.mission_file import MOST_TEXT, ready_missions
from msbot_school.missions.recorded_missions import PlayedMission, played_from_json
from msbot_web.mission_report import report_body, report_page
from msbot_web.models.class_models import MissionState
from msbot_web.pages.gallery import as_sentence
from msbot_web.pages.layout import page_frame
from msbot_web.pages.number_field import NumberField
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import file_button, heading, panel
from msbot_web.service import Service

FIRST = "one-silent"
"""The ready mission that is offered first: the easiest one."""
WHOLE = "-"
"""In a choice of slots: the robot as a whole."""


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/missions")
    def missions(request: Request) -> None:
        with page_frame(service, request, "/missions", "Missions") as page:
            _Missions(page)


class _Missions:
    """The whole page; what it shows changes when a mission begins or ends."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._seen: object = None
        self._left: ui.label | None = None
        self._found: ui.label | None = None
        self._told: ui.column | None = None
        self._told_seen: object = None
        self._now = ui.column().classes("w-full").style("gap:1rem")
        self._reports = ui.column().classes("w-full").style("gap:1rem")
        page.every_look(self._show)

    def _show(self) -> None:
        state = MissionState.model_validate(self._page.service.operations.missions.state())
        obstacles = {} if state.mission else self._page.service.operations.missions.obstacles()
        seen = (state.mission, state.reports, obstacles)
        if seen != self._seen:
            self._seen, self._told_seen = seen, None
            self._now.clear()
            with self._now:
                if state.mission:
                    self._make_running(state)
                else:
                    self._make_choice(state, obstacles)
            self._reports.clear()
            with self._reports:
                self._make_reports(state)
        if state.mission:
            self._refresh(state)

    # A mission runs.

    def _make_running(self, state: MissionState) -> None:
        page, say = self._page, self._page.translate
        with panel().style("display:flex;flex-direction:column;gap:.6rem"):
            with ui.element("div").classes("row spread"):
                heading(say(state.title))
                self._left = ui.label("").classes("num").style("font-size:1.6rem;font-weight:700")
                self._left.props(f'role=timer aria-label="{say("Time left")}"')
            ui.label(say(state.story)).style("max-width:60rem")
            self._found = ui.label("").classes("soft").props("role=status")
            if page.may(Right.ARRANGE):
                with ui.element("div").classes("row"):
                    ui.button(say("Stop the mission"), icon="stop", on_click=lambda: page.act("stop_mission")).props(
                        "outline dense"
                    )
        if page.may(Right.OPERATE):
            self._make_answering()
        with panel():
            heading(say("What was tried"))
            self._told = ui.column().classes("w-full").style("gap:.2rem")

    def _make_answering(self) -> None:
        page, say = self._page, self._page.translate
        slots = {WHOLE: say("the whole robot")} | {card.name: card.name for card in page.service.robot().slots}
        with panel():
            heading(say("What is wrong?"))
            with ui.element("div").classes("row").style("align-items:flex-end"):
                kinds = {name: f"{say(kind.words)} · {name}" for name, kind in KINDS.items()}
                kind = _choice(kinds, say("Fault"), "18rem")
                where = _choice(slots, say("Where"), "9rem")

                async def answer() -> None:
                    if kind.value is None or where.value is None:
                        ui.notify(say("Choose a fault and a place first."), type="warning")
                        return
                    await self._ask("answer_mission", kind=str(kind.value), at=_slot(where))

                ui.button(say("That is it"), icon="check", on_click=answer)
            heading(say("Have it mended")).style("margin-top:1rem")
            with ui.element("div").classes("row").style("align-items:flex-end"):
                repairs = {name: say(repair.words) for name, repair in REPAIRS.items()}
                repair = _choice(repairs, say("Repair"), "18rem")
                at = _choice(slots, say("Where"), "9rem")

                async def mend() -> None:
                    if repair.value is None or at.value is None:
                        ui.notify(say("Choose a repair and a place first."), type="warning")
                        return
                    await self._ask("repair", repair=str(repair.value), at=_slot(at))

                ui.button(say("Do it"), icon="build", on_click=mend)
                ui.button(say("A hint, please"), icon="lightbulb", on_click=lambda: self._ask("mission_hint")).props(
                    "flat"
                )

    async def _ask(self, operation: str, **arguments: str) -> None:
        """Say what came of it without the green of success: a wrong answer is none."""
        done = await self._page.act(operation, quiet=True, **arguments)
        if done is not None and not self._page.is_gone:
            with self._page.in_page():
                ui.notify(self._page.translate(done.words), multi_line=True, timeout=6000)

    def _refresh(self, state: MissionState) -> None:
        say = self._page.translate
        assert self._left is not None and self._found is not None and self._told is not None  # noqa: PT018
        self._left.set_text(f"{int(state.left_s) // 60}:{int(state.left_s) % 60:02d}")
        self._found.set_text(
            say(
                "Named: {found} of {to_find} · mended: {mended} of {to_mend} · hints left: {hints}",
                found=state.found,
                to_find=state.to_find,
                mended=state.mended,
                to_mend=state.to_mend,
                hints=state.hints_left,
            )
        )
        seen = (state.told, state.hints, state.tasks)
        if seen == self._told_seen:
            return
        self._told_seen = seen
        self._told.clear()
        with self._told:
            for task in state.tasks:
                with ui.element("div").classes("row"):
                    ui.icon("check_box" if task.done else "check_box_outline_blank").props("aria-hidden=true")
                    ui.label(say(task.words) + (f" ({say('done')})" if task.done else ""))
            for words in state.hints:
                with ui.element("div").classes("row").style("flex-wrap:nowrap"):
                    ui.icon("lightbulb").props("aria-hidden=true")
                    ui.label(say(words))
            for line in reversed(state.told):
                when = self._page.number(line.at_s, ".0f")
                ui.label(f"{when} s · {line.who} · {say(line.text)}")
            if not state.told and not state.hints and not state.tasks:
                ui.label(say("Nothing yet.")).classes("soft")

    # None runs.

    def _make_choice(self, state: MissionState, obstacles: Mapping[str, str]) -> None:
        page, say = self._page, self._page.translate
        with panel().classes("no-print" if state.reports else ""):  # on paper there is the report
            heading(say("No mission runs"))
            if not page.may(Right.ARRANGE):
                ui.label(say("A teacher starts one here. Then something goes wrong, and you find out what."))
                return
            ready = ready_missions()
            other = f" · {say('needs another robot')}"
            titles = {
                name: f"{say(one.title)} · {name}{other if name in obstacles else ''}" for name, one in ready.items()
            }
            first = next((name for name in (FIRST, *ready) if name not in obstacles), FIRST)
            with ui.element("div").classes("row").style("align-items:flex-start"):
                chosen = ui.select(titles, value=first, label=say("Mission"))
                chosen.props("dense outlined").style("min-width:min(20rem,100%);max-width:100%")
                seed = NumberField(page, say("Seed"), is_whole=True, may_be_negative=False)
                seed.props("dense outlined").style("width:7rem")

                async def start() -> None:
                    if seed.validate():
                        await page.act("start_mission", mission=str(chosen.value), seed=seed.number)

                async def taken(event: UploadEventArguments) -> None:
                    text = (await event.file.read()).decode("utf-8", "replace")
                    if not seed.validate():
                        return
                    name = PurePath(event.file.name).name
                    with page.in_page():
                        await page.act("start_mission", mission=name, toml=text, seed=seed.number)

                begin = ui.button(say("Start"), icon="play_arrow", on_click=start)
                file_button(page, say("Mission from a file"), taken, max_size=MOST_TEXT, ending=".toml")
            words = ui.label("").style("margin-top:.6rem;max-width:60rem")
            needs = ui.label("").classes("soft")
            another = ui.label("").props("role=status")
            to_others = ui.link(say("Robots and worlds"), "/gallery")

        def told() -> None:
            one = ready[str(chosen.value)]
            words.set_text(say(one.story))
            why = obstacles.get(one.name, "")
            begin.set_enabled(not why)
            another.set_visibility(bool(why))
            to_others.set_visibility(bool(why))
            another.set_text(as_sentence(say(why)) if why else "")
            needs.set_text(
                say(
                    "{minutes} min; needs the slots {slots} (robot {sample})",
                    minutes=f"{one.time_s / 60:g}",
                    slots=", ".join(one.needs) or "-",
                    sample=one.sample or "-",
                )
            )

        chosen.on_value_change(told)
        told()

    # What is over.

    def _make_reports(self, state: MissionState) -> None:
        if not state.reports:
            return
        page, say = self._page, self._page.translate
        newest = list(reversed(state.reports))
        with panel():
            with ui.element("div").classes("row spread"):
                heading(say("Reports")).classes("no-print")
                with ui.element("div").classes("row"):
                    number = ui.select(newest, value=newest[0], label=say("Mission")).props("dense outlined")
                    number.style("min-width:6rem")
                    download = ui.button(say("Report (HTML)"), icon="download").props("flat")
            shown = ui.html("", sanitize=False).classes("w-full")

        async def played() -> PlayedMission:
            found = page.service.operations.missions.report(int(number.value))
            return await asyncio.to_thread(played_from_json, found)

        async def show() -> None:
            shown.set_content(report_body(await played(), page.language))

        async def save() -> None:
            found = await played()
            ui.download.content(report_page(found, page.language), f"{found.mission.name}-{found.number}.html")

        number.on_value_change(show)
        download.on_click(save)
        if not state.mission:
            page.show_when_ready(show())


def _choice(options: dict[str, str], label: str, width: str) -> ui.select:
    return ui.select(options, label=label).props("dense outlined").style(f"min-width:min({width},100%);max-width:100%")


def _slot(choice: ui.select) -> str:
    return "" if choice.value == WHOLE else str(choice.value)
