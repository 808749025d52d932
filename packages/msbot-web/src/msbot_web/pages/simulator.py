"""Simulated parts by mouse: press the button, turn the knob, warm the air, pull the plug."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from nicegui import ui

from msbot_web.models.robot_models import Scalar, SimulatedPartControl
from msbot_web.pages.number_field import NumberField
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import END_WITH_MASTER, heading
from msbot_web.pages.slider import Slider
from msbot_web.svg.drawings import fields_html


def simulator_panel(page: Page, slot: str, *, title: str = "") -> None:
    """The controls of a simulated part and what one would see of it."""
    service = page.service
    with ui.element("div").classes("panel").style("background:var(--accent-soft)"):
        heading(title or page.translate("Simulated part"))
        plugged = ui.switch(page.translate("Plugged in"), value=service.views.bench.is_plugged(slot))
        controls = ui.element("div").classes("w-full")
        seen = ui.html("", sanitize=False)
        if slot in service.operations.stand_ins.names:
            ui.label(page.translate(END_WITH_MASTER)).classes("soft")

    def plug() -> None:
        wanted = bool(plugged.value)
        if wanted != service.views.bench.is_plugged(slot):  # otherwise the refresh below has set the switch
            page.do_now(lambda session: service.plug(session, slot, plugged=wanted), quiet=True)

    shown: list[str] = []

    def show() -> None:
        simulated = service.views.simulated(slot)
        plugged.value = simulated.plugged  # somebody else may have pulled it out
        names = [control.name for control in simulated.controls]
        if names != shown:  # a part that is not plugged in has none
            shown[:] = names
            controls.clear()
            with controls:
                for control in simulated.controls:
                    _control(page, slot, control)
        words = service.views.bench.reading_words(slot)
        readings = {_words(page, name, words): value for name, value in simulated.readings.items()}
        content = fields_html(readings, page.language, limit=16)
        if seen.content != content:
            seen.set_content(content)

    page.every_look(show, seen)
    plugged.on_value_change(plug)


def _words(page: Page, reading: str, known: Mapping[str, tuple[str, str]]) -> str:
    """What a reading means, with its unit; its name where it has no words."""
    words, unit = known.get(reading, (reading, ""))
    return f"{page.translate(words)} [{unit}]" if unit else page.translate(words)


_HELD = '(event) => { if ([" ", "Enter"].includes(event.key) && !event.repeat) emit(); }'
"""A button that is pressed as long as its key is."""


def _control(page: Page, slot: str, control: SimulatedPartControl) -> None:
    title = page.translate(control.words) or control.name
    unit = f" [{control.unit}]" if control.unit else ""

    async def changed(value: Scalar | None) -> None:
        await page.do(partial(page.operate, slot, control.name, "" if value is None else value), quiet=True)

    rest = page.service.views.bench.rest_value(slot, control.name)
    if control.kind == "bool" and rest is not None:
        # Not what it is now: somebody else may be pressing it.
        button = ui.button(title, icon="touch_app").props("outline")
        button.on("pointerdown", lambda: changed(not rest)).on("pointerup", lambda: changed(rest))
        button.on("pointerleave", lambda: changed(rest))
        button.on("keydown", lambda: changed(not rest), js_handler=_HELD)
        button.on("keyup", lambda: changed(rest), js_handler=_HELD)
        button.on("blur", lambda: changed(rest))
    elif control.kind == "bool":
        ui.switch(title, value=bool(control.value), on_change=lambda event: changed(event.value))
    elif control.kind == "number" and control.least is not None and control.most is not None:
        value = float(control.value) if isinstance(control.value, int | float) else control.least
        slider = Slider(
            page.language,
            f"{title}{unit}",
            least=control.least,
            most=control.most,
            value=value,
            unit=control.unit,
            on_number=changed,
        )
        if isinstance(rest, int | float) and page.client is not None:  # let go of with the connection: it shows that
            page.client.on_disconnect(partial(slider.put, float(rest)))
    elif control.kind == "number":
        NumberField(page, f"{title}{unit}", number=float(control.value or 0), on_number=changed)
    elif control.kind == "choice":
        ui.select(control.choices, label=title, value=control.value, on_change=lambda event: changed(event.value))
    else:
        ui.input(title, value=str(control.value or ""), on_change=lambda event: changed(event.value))
