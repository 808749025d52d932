"""The editor of programs and blueprints."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

from nicegui import ui
from nicegui.events import GenericEventArguments

if TYPE_CHECKING:
    from nicegui.elements.codemirror.constants import SUPPORTED_THEMES

_COLOURS: dict[str, tuple[SUPPORTED_THEMES, SUPPORTED_THEMES]] = {
    "basic": ("basicLight", "basicDark"),
    "github": ("githubLight", "githubDark"),
}
"""Of the text, by day and by night."""


class Editor(ui.codemirror):
    """CodeMirror, light or dark with its page. What is typed stays, whatever else of the editor is changed meanwhile.

    The browser tells the look of its page by itself: asked, it may be asleep and never answer.

    Args:
        text: what is in it at first.
        language: of the text.
        family: of the colours.
    """

    def __init__(self, text: str, *, language: Literal["Python", "TOML"], family: Literal["basic", "github"]) -> None:
        self._is_new = True
        self._colours = _COLOURS[family]
        super().__init__(text, language=language, theme=self._colours[0])
        self.on("update:value", js_handler=f"() => msbotTyped({self.id})")
        ui.on("ms_look", self._look)
        ui.run_javascript("msbotLook()")

    def _look(self, event: GenericEventArguments) -> None:
        light, dark = self._colours
        self.theme = dark if event.args is True else light

    def _handle_value_change(self, value: str) -> None:
        # What the browser has told is no news to it.
        self._is_new = self._is_new or self._send_update_on_value_change
        super()._handle_value_change(value)

    def _to_dict(self) -> dict[str, Any]:
        """What the browser is told. With the text only if that was set here: its own may be newer than ours."""
        told = super()._to_dict()
        if not self._is_new:
            told.setdefault("preserved_props", []).append("value")
        self._is_new = False
        return told
