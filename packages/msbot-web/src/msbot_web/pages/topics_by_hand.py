"""Ports joined by hand on the wires page: on the topic there is, or on a new one, whose name the person is asked for."""

from __future__ import annotations

from collections.abc import Container
from typing import Any

from nicegui import ui

from msbot_web.api.models import WirePort
from msbot_web.pages.layout import Page
from msbot_web.pages.page_elements import heading, show_dialog

LONGEST_NAME = 254
"""Characters of a topic's or slot's name, as the operations take them."""


async def join(page: Page, start: str, end: str) -> None:
    """Have a port hear what another one publishes; if that one has no topic yet, a new one is asked for.

    Args:
        page: where.
        start: the port that publishes, as `SLOT.port`.
        end: the port that is to hear it.
    """
    source, target = _port(page, start), _port(page, end)
    if source is None or target is None:
        return  # another blueprint holds by now
    if not source.topic:
        _ask_for_topic(page, start, end)
    elif target.topic == source.topic:
        ui.notify(page.say("These two are joined already."), type="info")
    else:
        await _bind(page, source, target, source.topic)


def say_misfit(page: Page, one: str, other: str) -> None:
    """Say why two ports, as `SLOT.port`, cannot be joined."""
    first, second = _port(page, one), _port(page, other)
    if first is None or second is None:
        return  # another blueprint holds by now
    if first.type_name != second.type_name:
        words = page.say(
            "{one} carries {type}, {other} carries {other_type}: only ports with the same message can be joined.",
            one=one, other=other, type=first.type_name, other_type=second.type_name,
        )  # fmt: skip
    elif first.publishes:
        words = page.say(
            "{one} and {other} both publish: join one that publishes with one that hears.", one=one, other=other
        )
    else:
        words = page.say(
            "{one} and {other} both hear: join one that publishes with one that hears.", one=one, other=other
        )
    ui.notify(words, type="warning", multi_line=True)


def free_name(wanted: str, taken: Container[str]) -> str:
    """The name itself, or with the lowest number behind it that makes it another one."""
    name, number = wanted, 1
    while name in taken:
        number += 1
        name = f"{wanted}_{number}"
    return name


def _port(page: Page, end: str) -> WirePort | None:
    return next((port for port in page.service.views.ports() if f"{port.slot}.{port.port}" == end), None)


def _ask_for_topic(page: Page, start: str, end: str) -> None:
    say, views = page.say, page.service.views

    async def make() -> None:
        topic = str(name.value or "").strip()
        source, target = _port(page, start), _port(page, end)  # as they are now: others wire, too
        if not topic:
            ui.notify(say("Give the topic a name."), type="negative")
        elif topic in {line.topic for line in views.topics()}:
            ui.notify(say("There is a topic {topic} already: choose another name.", topic=topic), type="negative")
        elif source is None or target is None or await _bind(page, source, target, topic):
            dialog.close()

    with ui.dialog() as dialog, ui.card().classes("w-full").style("max-width:min(28rem,95vw)"):
        heading(say("New topic"))
        ui.label(say("{source} publishes on it, {target} hears it.", source=start, target=end)).classes("soft")
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
