"""The parameters of one slot as a form: kind, range, unit, default and origin; a change is live at once.

A field shows the value in force: a refused input reverts to it, and changes by others appear, too.
"""

from __future__ import annotations

from nicegui import ui

from msbot.operations.rights import Right
from msbot_web.html import render
from msbot_web.models.robot_models import Scalar, Value
from msbot_web.pages.number_field import NumberField
from msbot_web.pages.page import Page
from msbot_web.pages.wires import edit_wires
from msbot_web.svg.drawings import value_words
from msbot_xrce.errors import MsbotError


def parameter_panel(page: Page, slot: str) -> None:
    """The form of a slot's parameters."""
    _Form(page, slot)


class _Form:
    """The lines of a slot, read again whenever somebody has changed something."""

    def __init__(self, page: Page, slot: str) -> None:
        self._page = page
        self._slot = slot
        self._form = ui.column().classes("w-full").style("gap:.4rem")
        self._safe = ui.column().classes("w-full").style("gap:.2rem")
        self._lines: dict[str, _ParameterRow] = {}
        self._mark: object = None
        page.every_look(self._look, self._form)

    async def _look(self) -> None:
        mark = self._page.service.views.version_mark()
        if mark is not self._mark:
            await self.read()
            self._mark = mark

    async def read(self) -> None:
        """Show what holds now."""
        self._show_safe()
        try:
            values = await self._page.service.values(self._slot)
        except MsbotError as error:
            self._say(self._page.translate(str(error)))
            return
        if not values:
            self._say(self._page.translate("This part has nothing to set."))
        elif [*self._lines] != [value.name for value in values]:
            self._form.clear()
            with self._form:
                self._lines = {value.name: _ParameterRow(self, self._page, self._slot, value) for value in values}
        else:
            for value in values:
                self._lines[value.name].show(value)

    def _show_safe(self) -> None:
        page = self._page
        self._safe.clear()
        with self._safe:
            for line in page.service.views.safe_values(self._slot):
                value = f"{value_words(line.value, page.language)} {line.unit}".rstrip()
                port = f"{line.port}.{line.field}"
                words = (
                    page.translate(
                        "Without a partner: {port} {value}. On STOP: {what}",
                        port=port,
                        value=value,
                        what=line.stops_by,
                    )
                    if line.stops_by
                    else page.translate("On STOP: {port} {value}", port=port, value=value)
                )
                with ui.element("div").classes("row w-full"):
                    ui.label(words).classes("soft").style("flex:1")
                    ui.html(render("origin", origin=line.origin, words=page.translate(line.origin)), sanitize=False)

    def _say(self, words: str) -> None:
        self._lines = {}
        self._form.clear()
        with self._form:
            ui.label(words).classes("soft")


class _ParameterRow:
    """One parameter."""

    def __init__(self, form: _Form, page: Page, slot: str, value: Value) -> None:
        self._form = form
        self._page = page
        self._slot = slot
        self._value = value
        with ui.element("div").classes("row w-full").style("flex-wrap:nowrap"):
            with ui.element("div").style("flex:1;min-width:0"):
                self._field = self._make_field()
                self._said = self._field.value
                """What the field showed last; another value in it is being typed."""
            if value.kind == "part" and page.may_at(Right.SET, slot):
                wires = ui.button(icon="cable", on_click=self._edit_wires).props("flat round dense")
                words = page.translate("Choose part and pins")
                wires.props["aria-label"] = wires.props["title"] = f"{words}: {value.name}"
            self._origin = ui.html("", sanitize=False)
            self._reset = ui.button(icon="restart_alt", on_click=self._forget).props("flat round dense")
            words = page.translate("Forget what was set by hand")
            self._reset.props["aria-label"] = self._reset.props["title"] = words
        if not page.may_at(Right.SET, slot):
            self._field.props("readonly disable")
        self.show(value)

    def show(self, value: Value) -> None:
        """Show what holds; what somebody is typing stays until it is typed."""
        self._value = value
        if self._field.value == self._said:
            self._field.value = self._said = self._shown(value)
        self._origin.set_content(render("origin", origin=value.origin, words=self._page.translate(value.origin)))
        self._reset.set_visibility(value.origin == "hand" and self._page.may_at(Right.SET, self._slot))

    async def _typed(self) -> None:
        self._said = self._field.value
        wanted = self._wanted()
        if wanted is None or wanted == self._value.value:
            return
        done = await self._page.act("set", slot=self._slot, name=self._value.name, value=wanted)
        if done is None:
            self.show(self._value)
        else:
            await self._form.read()

    async def _edit_wires(self) -> None:
        await edit_wires(self._page, self._slot, self._value.name, self._form.read)

    async def _forget(self) -> None:
        if await self._page.act("reset", slot=self._slot, name=self._value.name) is not None:
            await self._form.read()

    def _wanted(self) -> Scalar | None:
        typed = self._field.value
        if typed is None:
            return None
        if self._value.kind == "bool":
            return bool(typed)
        if isinstance(self._field, NumberField):
            number = self._field.number
            return float(number) if self._value.kind == "float" and number is not None else number
        return str(typed)

    def _shown(self, value: Value) -> bool | str:
        if value.kind == "bool":
            return bool(value.value)
        if isinstance(self._field, NumberField):
            return self._field.written(0.0 if isinstance(value.value, str) else float(value.value))
        return str(value.value)

    def _make_field(self) -> ui.switch | ui.input:
        value = self._value
        title = f"{value.name} [{value.unit}]" if value.unit else value.name
        hint = " · ".join(filter(None, (self._page.translate(value.description), self._limits(), self._default())))
        if value.kind == "bool":
            switch = ui.switch(title, value=bool(value.value), on_change=self._typed)
            ui.label(hint).classes("soft").style("font-size:.8rem")
            return switch
        if value.kind in ("int", "float"):
            may_be_negative = value.least is None or value.least < 0
            field: ui.input = NumberField(
                self._page, title, is_whole=value.kind == "int", may_be_negative=may_be_negative
            )
        else:
            field = ui.input(title)
        field.on("change", self._typed)
        field.props("dense").classes("w-full").props["hint"] = hint
        return field

    def _default(self) -> str:
        return self._page.translate("default {value}", value=value_words(self._value.default, self._page.language))

    def _limits(self) -> str:
        least, most = self._value.least, self._value.most
        if least is None and most is None:
            return ""
        return " … ".join("" if end is None else self._page.number(end, "g") for end in (least, most))
