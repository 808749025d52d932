"""Saved views of the page Plots: names for addresses, which the person's browser keeps."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import TYPE_CHECKING

from nicegui import ui
from nicegui.events import GenericEventArguments

if TYPE_CHECKING:
    from msbot_web.pages.layout import Page


class SavedViews:
    """The fields and buttons for them.

    Args:
        page: where.
        address: of what is shown at present.
        go: shows what an address has.
    """

    def __init__(self, page: Page, address: Callable[[], str], go: Callable[[str], None]) -> None:
        self._page = page
        self._address = address
        self._go = go
        self._views: dict[str, str] = {}
        self._saved = ui.select([], label=page.say("Saved views"), on_change=self._open).props(
            "outlined dense options-dense"
        ).style("min-width:10rem")  # fmt: skip
        self._name = ui.input(page.say("Name of this view")).props("outlined dense maxlength=40")
        ui.button(page.say("Save"), icon="bookmark_add", on_click=self._save).props("flat")
        ui.button(page.say("Forget"), icon="bookmark_remove", on_click=self._forget).props("flat")
        ui.on("plots_views", self._know)

    def _know(self, event: GenericEventArguments) -> None:
        found = event.args if isinstance(event.args, dict) else {}
        self._views = {str(name): str(address) for name, address in found.items()}
        self._saved.set_options([*self._views])

    def _save(self) -> None:
        name = str(self._name.value or "").strip()
        if not name:
            ui.notify(self._page.say("Give the view a name first."), type="warning")
            return
        ui.run_javascript(f"msbotPlots.keep({json.dumps(name)}, {json.dumps(self._address())})")
        self._name.set_value("")
        ui.notify(self._page.say("{name} is saved in this browser", name=name), type="positive")

    def _forget(self) -> None:
        if self._saved.value:
            ui.run_javascript(f"msbotPlots.keep({json.dumps(str(self._saved.value))}, '')")
            self._saved.set_value(None)

    def _open(self) -> None:
        address = self._views.get(str(self._saved.value or ""), "")
        if address.startswith("/plots?"):
            self._go(address)
