"""A field for a number, written with a comma or a point.

`<input type=number>` reads 0,1 only in a browser that is itself German, whatever language the page is in; in any other
one the comma is dropped without a word, and 0,1 becomes 1.
"""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui
from nicegui.events import ValueChangeEventArguments

from msbot_web.pages.page import Page
from msbot_xrce.errors import ConfigError

DIGITS = ".15g"
"""More than anybody types; one less than those that show how a float is stored."""


class NumberField(ui.input):
    """See the module's docstring. What is no number is told under the field as soon as it is left.

    Args:
        page: in whose language it is written.
        title: what stands in it.
        number: what it shows; None: nothing.
        is_whole: whether it has to be a whole number.
        may_be_negative: whether its keyboard on a phone needs a minus.
        on_number: called with every number that is typed.
    """

    def __init__(
        self,
        page: Page,
        title: str,
        *,
        number: float | None = None,
        is_whole: bool = False,
        may_be_negative: bool = True,
        on_number: Callable[[float], object] | None = None,
    ) -> None:
        self._language = page.language
        self._is_whole = is_whole
        self._on_number = on_number
        super().__init__(title, value=self.written(number), on_change=self._typed, validation=self._complaint)
        self.without_auto_validation()
        # The keys for numbers on a phone have a comma, but not everywhere a minus.
        self.props(
            f"hide-bottom-space no-error-icon autocomplete=off inputmode={'text' if may_be_negative else 'decimal'}"
        )
        self.on("change", self.validate)

    @property
    def number(self) -> float | None:
        """What is typed; None: nothing, or no number."""
        try:
            return self._read()
        except ConfigError:
            return None

    @number.setter
    def number(self, number: float | None) -> None:
        self.value = self.written(number)

    def written(self, number: float | None) -> str:
        """A number as the field shows it."""
        return "" if number is None else self._language.number(number, "d" if isinstance(number, int) else DIGITS)

    def _read(self) -> float | None:
        text = str(self.value or "").strip()
        return self._language.read_number(text, is_whole=self._is_whole) if text else None

    def _complaint(self, _value: object) -> str | None:
        try:
            self._read()
        except ConfigError as error:
            return self._language.translate(str(error))
        return None

    def _typed(self, _event: ValueChangeEventArguments[str | None]) -> object:
        number = self.number
        if number is None:
            return None
        self.error = None
        return None if self._on_number is None else self._on_number(number)
