"""Slots made and taken out by hand on the wires page: a part type chosen from the library, and a question before."""

from __future__ import annotations

import re
from collections.abc import Container
from functools import partial
from typing import Any

from nicegui import ui
from nicegui.events import GenericEventArguments

from msbot.service_types import service_type
from msbot_web.models.robot_models import TypeLine, WirePort
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import ask_first, heading, show_dialog

# Ports joined by hand on the wires page: on the topic there is, or on a new one, whose name the person is asked for.


LONGEST_NAME = 254
"""Characters of a topic's or slot's name, as the operations take them."""


async def connect_ports(page: Page, start: str, end: str) -> None:
    """Have a port hear what another one publishes; if that one has no topic yet, a new one is asked for.

    Args:
        page: where.
        start: the port that publishes, as `SLOT.port`.
        end: the port that is to hear it.
    """
    source, target = wire_port(page, start), wire_port(page, end)
    if source is None or target is None:
        return  # another blueprint holds by now
    if not source.topic:
        _ask_for_topic(page, start, end)
    elif target.topic == source.topic:
        ui.notify(page.translate("These two are joined already."), type="info")
    else:
        await _bind(page, source, target, source.topic)


def say_misfit(page: Page, one: str, other: str) -> None:
    """Say why two ports, as `SLOT.port`, cannot be joined."""
    first, second = wire_port(page, one), wire_port(page, other)
    if first is None or second is None:
        return  # another blueprint holds by now
    is_service = service_type(first.type_name) is not None
    if first.type_name != second.type_name:
        words = page.translate(
            "{one} carries {type}, {other} carries {other_type}: only ports with the same message can be joined.",
            one=one,
            other=other,
            type=first.type_name,
            other_type=second.type_name,
        )
    elif first.publishes:
        words = page.translate(
            "{one} and {other} both serve: join one that serves with one that calls."
            if is_service
            else "{one} and {other} both publish: join one that publishes with one that subscribes.",
            one=one,
            other=other,
        )
    else:
        words = page.translate(
            "{one} and {other} both call: join one that serves with one that calls."
            if is_service
            else "{one} and {other} both subscribe: join one that publishes with one that subscribes.",
            one=one,
            other=other,
        )
    ui.notify(words, type="warning", multi_line=True)


def free_name(wanted: str, taken: Container[str]) -> str:
    """The name itself, or with the lowest number behind it that makes it another one."""
    name, number = wanted, 1
    while name in taken:
        number += 1
        name = f"{wanted}_{number}"
    return name


def wire_port(page: Page, end: str) -> WirePort | None:
    """The port, written `SLOT.port`, with the topic that it is wired to now; None: there is none."""
    return next((port for port in page.service.views.ports() if f"{port.slot}.{port.port}" == end), None)


async def make_wire(page: Page, end: str) -> None:
    """Give a port without a wire one of its own: people look at it, call it or send to it, and others can join later."""
    port = wire_port(page, end)
    if port is None or port.topic:
        return  # somebody else has made one, or taken the slot away
    taken = {line.topic for line in page.service.views.topics()}
    name = port.port if port.port not in taken else free_name(f"{port.slot}_{port.port}", taken)
    ends: dict[str, Any] = {"from": end, "to": []} if port.publishes else {"to": [end]}
    await page.act("bind", topic=name, type=port.type_name, **ends)


def _ask_for_topic(page: Page, start: str, end: str) -> None:
    say, views = page.translate, page.service.views

    async def make() -> None:
        topic = str(name.value or "").strip()
        source, target = wire_port(page, start), wire_port(page, end)  # as they are now: others wire, too
        if not topic:
            ui.notify(say("Give the topic a name."), type="negative")
        elif topic in {line.topic for line in views.topics()}:
            ui.notify(say("There is a topic {topic} already: choose another name.", topic=topic), type="negative")
        elif source is None or target is None or await _bind(page, source, target, topic):
            dialog.close()

    with ui.dialog() as dialog, ui.card().classes("w-full").style("max-width:min(28rem,95vw)"):
        heading(say("New topic"))
        port = wire_port(page, start)
        is_service = port is not None and service_type(port.type_name) is not None
        told = (
            say("{source} serves it, {target} calls.", source=start, target=end)
            if is_service
            else say("{source} publishes on it, {target} subscribes to it.", source=start, target=end)
        )
        ui.label(told).classes("soft")
        proposal = free_name(start.replace(".", "_"), {line.topic for line in views.topics()})
        name = ui.input(say("Name of the topic"), value=proposal).classes("w-full")
        name.props(f"outlined autofocus maxlength={LONGEST_NAME}").on("keydown.enter", make)
        with ui.element("div").classes("row"):
            ui.button(say("Join"), icon="add_link", on_click=make)
            ui.button(say("Cancel"), on_click=dialog.close).props("flat")
    show_dialog(dialog)


async def _bind(page: Page, source: WirePort, target: WirePort, topic: str) -> bool:
    """Join both on a topic; the target leaves the one that it hears, in the same change."""
    end = f"{target.slot}.{target.port}"
    arguments: dict[str, Any] = {"topic": topic, "type": source.type_name, "to": [end], "move": True}
    if not source.topic:
        arguments["from"] = f"{source.slot}.{source.port}"
    return await page.act("bind", **arguments) is not None


# Part types found by words, those of the library or those of the person's language.


def types_found(page: Page, wanted: str) -> list[TypeLine]:
    """The part types that fit, by their own words or by those of the person's language."""
    fitting, words = page.service.views.types(wanted), wanted.casefold().split()
    known = {line.number for line in fitting}
    return fitting + [
        line
        for line in page.service.views.types("")
        if line.number not in known
        and all(word in f"{page.translate(line.name)} {page.translate(line.description)}".casefold() for word in words)
    ]


def ask_for_slot(page: Page, number: str = "") -> None:
    """Ask for the part type and the name of a new slot, and make it; with a part number, that type is chosen."""
    _NewSlot(page, number)


def ask_to_take_out(page: Page, slot: str) -> None:
    """Ask once more before a slot is taken out of the robot."""
    words = page.translate(
        "Take slot {slot} out of the robot? Its wires go with it, and its part leaves the robot. The journal brings "
        "the slot back; so does robot.toml when it is applied again, if it has the slot.",
        slot=slot,
    )
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
        say = page.translate
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
        options = {line.number: f"{self._page.translate(line.name)} · {line.number}" for line in found}
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
        words = self._page.translate("Left empty, it is called {name}.", name=self._proposed)
        self._hint.set_text(words if self._proposed else "")

    async def _make(self) -> None:
        name, purpose = str(self._name.value or "").strip() or self._proposed, str(self._purpose.value or "").strip()
        if not self._types.value:
            ui.notify(self._page.translate("Choose a part type first."), type="negative")
            return
        done = await self._page.act("add_slot", slot=name, part=str(self._types.value), description=purpose)
        if done is not None:
            self._dialog.close()
