"""The parameters of one slot as a form: kind, range, unit, default and origin; a change is live at once."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from html import escape

from nicegui import ui

from msbot.errors import MsbotError
from msbot.web.accounts import Session
from msbot.web.models import Done, Scalar, Value
from msbot.web.pages.layout import Page
from msbot.web.roles import Right


def values_panel(page: Page, slot: str) -> None:
    """The form of a slot's parameters."""
    form = ui.column().classes("w-full").style("gap:.4rem")

    def fill() -> None:
        form.clear()
        with form:
            try:
                values = page.service.values(slot)
            except MsbotError as error:
                ui.label(str(error)).classes("soft")
                return
            if not values:
                ui.label(page.say("This part has nothing to set.")).classes("soft")
            for value in values:
                _line(page, slot, value, fill)

    fill()


def _line(page: Page, slot: str, value: Value, again: Callable[[], None]) -> None:
    def set_value(wanted: Scalar | None) -> None:
        if wanted is None or wanted == value.value:
            return
        if page.do(partial(_set, page, slot, value, wanted)) is not None:
            again()

    def reset() -> None:
        if page.do(lambda session: page.service.reset_value(session, slot, value.name)) is not None:
            again()

    with ui.element("div").classes("row w-full").style("flex-wrap:nowrap"):
        with ui.element("div").style("flex:1;min-width:0"):
            _field(page, value, set_value)
        ui.html(f'<span class="origin {escape(value.origin)}">{escape(page.say(value.origin))}</span>', sanitize=False)
        if value.origin == "hand" and page.may(Right.SET):
            ui.button(icon="restart_alt", on_click=reset).props(
                f'flat round dense aria-label="{escape(page.say("Forget what was set by hand"))}"'
            )


def _field(page: Page, value: Value, set_value: Callable[[Scalar | None], None]) -> None:
    unit = f" [{value.unit}]" if value.unit else ""
    limits = "" if value.least is None and value.most is None else (
        f"{'' if value.least is None else format(value.least, 'g')} … {'' if value.most is None else format(value.most, 'g')}"
    )  # fmt: skip
    hint = " · ".join(filter(None, (value.description, limits, page.say("default {value}", value=value.default))))
    is_open = page.may(Right.SET)
    if value.kind == "bool":
        field: ui.element = ui.switch(
            f"{value.name}{unit}", value=bool(value.value), on_change=lambda event: set_value(bool(event.value))
        )
        ui.label(hint).classes("soft").style("font-size:.8rem")
    elif value.kind in ("int", "float"):
        number = ui.number(f"{value.name}{unit}", value=float(value.value) if not isinstance(value.value, str) else 0.0,
                           min=value.least, max=value.most, step=1 if value.kind == "int" else None)  # fmt: skip

        def typed() -> None:
            if number.value is not None:
                set_value(int(number.value) if value.kind == "int" else float(number.value))

        number.on("change", typed)
        field = number.props(f'hint="{escape(hint, quote=True)}" dense').classes("w-full")
    else:
        text = ui.input(f"{value.name}{unit}", value=str(value.value))
        text.on("change", lambda: set_value(str(text.value)))
        field = text.props(f'hint="{escape(hint, quote=True)}" dense').classes("w-full")
    if not is_open:
        field.props("readonly disable")


def _set(page: Page, slot: str, value: Value, wanted: Scalar, session: Session) -> Done:
    return page.service.set_value(session, slot, value.name, wanted)
