"""The fault lab on the page: what can go wrong, planted by a click; what is planted, ended by another."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fastapi import Request
from nicegui import ui

from msbot.operations.rights import Right
from msbot_school.faults.fault_engine import FOR_S
from msbot_school.faults.fault_kinds import KINDS, Amount
from msbot_web.access.sessions import Session
from msbot_web.models.robot_models import ChangeResult
from msbot_web.pages.layout import page_frame
from msbot_web.pages.number_field import NumberField
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import ask_first, heading, panel, show_dialog
from msbot_web.service import Service


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/faults")
    def faults(request: Request) -> None:
        with page_frame(service, request, "/faults", "Faults") as page:
            if not page.may(Right.ARRANGE):
                ui.label(page.translate("Only a teacher sees this page.")).classes("ms-banner warn")
                return
            _Form(page)
            _Planted(page)


class _Form:
    """Plants a fault."""

    def __init__(self, page: Page) -> None:
        self._page = page
        say = page.translate
        slots = [card.name for card in page.service.robot().slots]
        kinds = {name: f"{name} · {say(kind.words)}" for name, kind in KINDS.items()}
        with panel():
            heading(say("Plant a fault"))
            with ui.element("div").classes("row").style("align-items:flex-start"):
                self._kind = ui.select(kinds, value="loss", label=say("Fault"), on_change=self._chosen)
                self._kind.props("dense outlined").style("min-width:min(16rem,100%);max-width:100%")
                self._slot = ui.select(slots, value=slots[0] if slots else None, label=say("Slot"))
                self._slot.props("dense outlined").style("min-width:8rem")
                self._amount = NumberField(page, "")
                self._amount.props("dense outlined").style("width:9rem")
                self._after = NumberField(page, say("After [s]"), number=0, may_be_negative=False)
                self._after.props("dense outlined").style("width:7rem")
                self._for = NumberField(page, say("For [s]"), number=FOR_S, may_be_negative=False)
                self._for.props("dense outlined").style("width:7rem")
                self._when = ui.input(say("When")).props('dense outlined placeholder="knob.level > 60"')
                self._hidden = ui.checkbox(say("Hidden"))
                ui.button(say("Plant"), icon="bug_report", on_click=self._plant)
            self._words = ui.label("").classes("soft").style("margin-top:.6rem")
        self._chosen()

    def _chosen(self) -> None:
        say, kind = self._page.translate, KINDS[str(self._kind.value)]
        self._slot.set_visibility(kind.at_part)
        self._amount.set_visibility(kind.amount is not None)
        strength = "" if kind.amount is None else f"{self._label(kind.amount)} {say(kind.amount.words)}. "
        self._words.set_text(strength + say(_WHERE[kind.acts.name]))
        if kind.amount is not None:
            self._amount.props["label"] = self._label(kind.amount)
            # What fits this robot's beats is worked out when it is planted.
            self._amount.number = None if kind.name == "late" else kind.amount.default
            self._amount.update()

    def _label(self, amount: Amount) -> str:
        return f"{self._page.translate('Amount')} [{amount.unit}]"

    async def _plant(self) -> None:
        kind = KINDS[str(self._kind.value)]
        asked = [self._after, self._for] if kind.amount is None else [self._amount, self._after, self._for]
        if not all([field.validate() for field in asked]):  # all of them, so that each says what is wrong with it
            return
        during: dict[str, Any] = {"for": self._for.number}
        await self._page.act(
            "plant_fault",
            kind=kind.name,
            at=str(self._slot.value or "") if kind.at_part else "",
            amount=None if kind.amount is None else self._amount.number,
            after=self._after.number or 0.0,
            when=str(self._when.value or ""),
            hidden=bool(self._hidden.value),
            **during,
        )


_WHERE = {
    "EDGE": "Works on real and simulated parts.",
    "GUEST": "A simulated part comes that should not be there; the right one is cut off if it has to be.",
    "SENSOR": "Acts in a part that is simulated in the master's process.",
    "BUS": "Acts on a CAN bus that is simulated in the master's process.",
    "MASTER": "Acts in the master.",
}


class _Planted:
    """What is planted."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._seen: list[object] | None = None
        self._times: dict[object, ui.label] = {}
        with panel():
            with ui.element("div").classes("row spread"):
                heading(page.translate("Planted faults"))
                with ui.element("div").classes("row"):
                    self._answers = ui.button(
                        page.translate("Show the answers"), icon="visibility", on_click=self._look
                    )
                    self._answers.props("flat dense")
                    self._all = ui.button(page.translate("End all"), icon="healing", on_click=self._end_all)
                    self._all.props("flat dense")
            self._list = ui.column().classes("w-full").style("gap:0")
        page.every_look(self._show)

    def _look(self) -> None:
        words = self._page.translate(
            "Show what the mission wants to be found? Its report will say that you have looked."
        )
        ask_first(self._page, words, self._show_answers)

    async def _show_answers(self) -> None:
        """What a mission hides; the mission notes who has looked."""
        found: list[Mapping[str, object]] = []

        async def deed(session: Session) -> ChangeResult:
            operations, who = self._page.service.operations, self._page.service.asker(session)
            faults = (await operations.do("faults", who=who, answers=True)).answer["faults"]
            assert isinstance(faults, list)
            found.extend(faults)
            return ChangeResult(words="")

        if await self._page.do(deed, quiet=True) is None:
            return
        with ui.dialog() as dialog, ui.card():
            for fault in found:
                words = str(fault["words"])
                ui.label(f"{fault['number']}. {self._page.translate(words)}")
            ui.button(self._page.translate("Close"), on_click=dialog.close).props("flat")
        show_dialog(dialog)

    async def _end_all(self) -> None:
        await self._page.act("clear_fault")

    def _show(self) -> None:
        planted = self._page.service.operations.faults.listed()
        seen: list[object] = [(fault["number"], fault["words"]) for fault in planted]
        self._answers.set_visibility(any("concealed" in fault for fault in planted))
        self._all.set_visibility(bool(planted))
        if seen != self._seen:
            self._seen = seen
            self._list.clear()
            self._times.clear()
            with self._list:
                if not planted:
                    ui.label(self._page.translate("No fault is planted: everything that goes wrong now is real."))
                for fault in planted:
                    self._line(fault)
        for fault in planted:
            self._times[fault["number"]].set_text(self._state(fault))

    def _line(self, fault: Mapping[str, object]) -> None:
        say, number, words = self._page.translate, fault["number"], str(fault["words"])
        with (
            ui.element("div").classes("row spread w-full").style("border-bottom:1px solid var(--line);padding:.35rem 0")
        ):
            with ui.element("div"):
                ui.label(f"{number}. {say(words)}")
                self._times[number] = ui.label("").classes("soft num")
            ui.button(say("End"), icon="close", on_click=lambda: self._page.act("clear_fault", fault=number)).props(
                "flat dense"
            )

    def _state(self, fault: Mapping[str, object]) -> str:
        planter = str(fault["who"])
        say, who = self._page.translate, self._page.translate(planter)
        if "concealed" in fault:
            return str(who)
        hidden = f" · {say('hidden')}" if fault["hidden"] else ""
        if fault["active"]:
            return say("{who} · {seconds:.0f} s left", who=who, seconds=fault["left_s"]) + hidden
        if fault["begins_in_s"] is not None:
            return say("{who} · begins in {seconds:.0f} s", who=who, seconds=fault["begins_in_s"]) + hidden
        return say("{who} · waits: {when}", who=who, when=fault["when"] or "-") + hidden
