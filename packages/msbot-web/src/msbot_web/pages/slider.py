"""A slider for a number: the browser's own, which everybody knows how to use, by pointer, finger, keyboard or voice.

Arrow keys go a step, Page up and Page down a tenth of the way, Home and End to its ends. What a screen reader says is the value as the
person's language writes it, with its unit (`msbotSlid` in `static/page.js`).
"""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui
from nicegui.events import GenericEventArguments

from msbot_web.language import Language
from msbot_web.page_errors import read_from_browser

STEPS = 200
"""So many steps from end to end."""
EVERY_S = 0.1
"""While it is moved, a value is told so often; the last one in any case."""


class Slider(ui.element):
    """See the module's docstring. It stays where it was put: late answers of the robot would take the next keys back.

    Args:
        language: of the person.
        title: its name, which is also written above it.
        least: its left end.
        most: its right end.
        value: where it is at first.
        unit: of the value.
        on_number: called with every value that it is put to.
    """

    def __init__(
        self,
        language: Language,
        title: str,
        *,
        least: float,
        most: float,
        value: float,
        unit: str,
        on_number: Callable[[float], object],
    ) -> None:
        ui.label(title)
        super().__init__("input")
        self._language, self._unit = language, unit
        self.classes("ms-slider")
        step = max((most - least) / STEPS, 1e-6)
        self.props.update({"type": "range", "min": least, "max": most, "step": step, "aria-label": title})
        self.props["data-unit"] = unit
        self.put(value)

        def handler(event: GenericEventArguments) -> object:
            with read_from_browser():
                number = float(event.args)
            return on_number(number)

        told = f"(event) => {{ msbotSlid({self.id}, event.target); emit(event.target.valueAsNumber); }}"
        self.on("input", handler, js_handler=told, throttle=EVERY_S)

    def put(self, value: float) -> None:
        """Put it somewhere, as if the person had not."""
        self.props["value"] = value
        self.props["aria-valuetext"] = f"{self._language.number(value, '.4g')} {self._unit}".strip()
        self.update()
