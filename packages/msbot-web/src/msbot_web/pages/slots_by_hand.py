"""Slots made and taken out by hand on the wires page: a part type chosen from the library, and a question before."""

from __future__ import annotations

import re
from functools import partial

from nicegui import ui
from nicegui.events import GenericEventArguments

from msbot_web.pages.layout import Page
from msbot_web.pages.page_elements import ask_first, heading, show_dialog
from msbot_web.pages.topics_by_hand import LONGEST_NAME, free_name
from msbot_web.pages.type_search import types_found


def ask_for_slot(page: Page, number: str = "") -> None:
    """Ask for the part type and the name of a new slot, and make it; with a part number, that type is chosen."""
    _NewSlot(page, number)


def ask_to_take_out(page: Page, slot: str) -> None:
    """Ask once more before a slot is taken out of the robot."""
    words = page.say(
        "Take slot {slot} out of the robot? Its wires go with it, and its part leaves the robot. The journal brings "
        "the slot back; so does robot.toml when it is applied again, if it has the slot.", slot=slot,
    )  # fmt: skip
    ask_first(page, words, partial(page.act, "remove_slot", slot=slot))


def slot_name(type_name: str) -> str:
    """A name for a slot after its part type: `servo` for a "Servo, 180 degrees"."""
    words = re.findall(r"\w+", re.split(r"[,(]", type_name)[0].lower())
    return "_".join(words) or "slot"


class TypeChoice(ui.radio):
    """Part types to choose from, told by their numbers.

    NiceGUI's own tells which line was clicked. When a search shortens the list at that moment, that line is another
    type, or none.
    """

    def _update_options(self) -> None:
        super()._update_options()
        pairs = zip(self._values, self._labels, strict=True)
        self._props["options"] = [{"value": number, "label": words} for number, words in pairs]

    def _event_args_to_value(self, e: GenericEventArguments) -> object:
        return e.args if e.args in self.options else self.value

    def _value_to_model_value(self, value: object) -> object:
        return value


class _NewSlot:
    """The dialog."""

    def __init__(self, page: Page, number: str) -> None:
        self._page = page
        self._proposed = ""
        say = page.say
        with ui.dialog() as self._dialog, ui.card().classes("w-full").style("max-width:min(32rem,95vw)"):
            heading(say("New slot"))
            self._search = ui.input(
                say("Search"), value=number, placeholder=say("servo, light, I2C …"), on_change=self._show
            )
            self._search.props("outlined dense clearable autofocus").classes("w-full")
            self._search.on("keydown.enter", self._take_first)
            with ui.element("div").classes("slot-types"):
                self._types = TypeChoice({}, on_change=self._propose)
                self._types.props["aria-label"] = say("Part type")
            self._nothing = ui.label(say("No part type fits these words: try fewer.")).props("role=status")
            self._name = ui.input(say("Name of the slot")).props(f"outlined dense maxlength={LONGEST_NAME}")
            self._name.classes("w-full").on("keydown.enter", self._make)
            # Beside the field, not in it: what somebody is typing there is never written over.
            self._hint = ui.label("").classes("soft")
            self._purpose = ui.input(say("What it is for (may be left empty)")).props("outlined dense maxlength=1000")
            self._purpose.classes("w-full").on("keydown.enter", self._make)
            ui.label(
                say(
                    "The robot keeps the slot, also after a restart. To have it in robot.toml, too, download the "
                    "blueprint under Settings."
                )
            ).classes("soft")
            with ui.element("div").classes("row"):
                ui.button(say("Make the slot"), icon="add", on_click=self._make)
                ui.button(say("Cancel"), on_click=self._dialog.close).props("flat")
        self._show()
        if number in self._types.options:
            self._types.value = number
        show_dialog(self._dialog)

    def _show(self) -> None:
        """The part types that fit the search; what was chosen stays chosen while it is among them."""
        found = types_found(self._page, str(self._search.value or ""))
        chosen = self._types.value
        options = {line.number: f"{self._page.say(line.name)} · {line.number}" for line in found}
        self._types.set_options(options, value=chosen if chosen in options else None)
        self._nothing.set_visibility(not options)

    def _take_first(self) -> None:
        """Enter in the search takes the first one."""
        found = types_found(self._page, str(self._search.value or ""))
        if found:
            self._types.value = found[0].number

    def _propose(self) -> None:
        """A name after the part type, for who writes none."""
        part_type = self._page.service.views.library.get(str(self._types.value or ""))
        taken = {card.name for card in self._page.service.robot().slots}
        self._proposed = "" if part_type is None else free_name(slot_name(part_type.name), taken)
        words = self._page.say("Left empty, it is called {name}.", name=self._proposed)
        self._hint.set_text(words if self._proposed else "")

    async def _make(self) -> None:
        name, purpose = str(self._name.value or "").strip() or self._proposed, str(self._purpose.value or "").strip()
        if not self._types.value:
            ui.notify(self._page.say("Choose a part type first."), type="negative")
            return
        done = await self._page.act("add_slot", slot=name, part=str(self._types.value), description=purpose)
        if done is not None:
            self._dialog.close()
