"""The part library as a catalogue with search; every entry has a page with pins, ports, and a code to stick on the part."""

from __future__ import annotations

from functools import partial

from fastapi import Request
from nicegui import ui

from msbot.config import PartType
from msbot.hardware.wiring_picture import wiring_picture
from msbot.operations.rights import Right
from msbot.pnp import versions_in_words
from msbot_web.html import Markup, render
from msbot_web.pages.layout import page_frame
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import ask_first
from msbot_web.pages.slot_dialogs import ask_for_slot, types_found
from msbot_web.pages.whose_part_fits import message_lines, named, substitutes, worlds_that_fit
from msbot_web.root_path import base_of
from msbot_web.service import Service
from msbot_web.svg.drawings import picture_of, qr_svg, value_words


def register(service: Service) -> None:
    """Make the pages known."""

    @ui.page("/library")
    def library(request: Request, search: str = "") -> None:
        with page_frame(service, request, "/library", "Library") as page:
            _catalogue(page, search)

    @ui.page("/library/{number}")
    def entry(request: Request, number: str) -> None:
        with page_frame(service, request, "/library", "Library") as page:
            found = service.views.library.get(number)
            if found is None:
                ui.label(page.translate("There is no part type {number} in the library.", number=number))
                ui.link(page.translate("Library"), "/library")
            else:
                _entry(page, found, base_of(request))
                if page.may(Right.DESIGN):
                    make = partial(ask_for_slot, page, found.number)
                    ui.button(page.translate("New slot for this type"), icon="add", on_click=make).classes("self-start")


def _catalogue(page: Page, search: str) -> None:
    find = ui.input(page.translate("Search"), value=search, placeholder=page.translate("servo, light, I2C …")).props(
        "outlined clearable autofocus"
    )
    find.classes("w-full")
    with ui.expansion(page.translate("Whose part fits?"), icon="handshake").classes("w-full"):
        _messages(page)
    grid = ui.html("", sanitize=False).classes("w-full")

    def show() -> None:
        entries = []
        for line in types_found(page, str(find.value or "")):
            found = page.service.views.library.get(line.number)
            entries.append((line, "" if found is None else picture_of(found)))
        grid.set_content(render("catalogue", say=page.translate, counted=page.language.count, entries=entries))

    find.on_value_change(show)
    show()


def _messages(page: Page) -> None:
    """Which part types have each of the standard messages: what sends it fits what it drives, whoever made them."""
    _table(
        page,
        "Parts fit each other that have the same message",
        ("Message", "Sent by", "Drives", "Other makers"),
        [
            (one.message, named(one.reports), named(one.driven), " · ".join(one.worlds) or "–")
            for one in message_lines(page.service.views.library, worlds_that_fit(), page.translate)
        ],
    )


def _range_words(page: Page, least: float | None, most: float | None) -> str:
    """What a parameter may be: "0 … 180", "≥ 0", "≤ 180", or "–" for anything."""
    if least is not None and most is not None:
        return f"{page.number(least, 'g')} … {page.number(most, 'g')}"
    if least is not None:
        return f"≥ {page.number(least, 'g')}"
    return "–" if most is None else f"≤ {page.number(most, 'g')}"


def _entry(page: Page, found: PartType, base: str) -> None:
    say = page.translate
    facts = [
        (say("part number"), found.number),
        (say("manufacturer"), say(found.manufacturer) or "–"),
        (say("supply"), say(str(found.supply)) if found.supply else say(found.specification) or "–"),
        (say("resolution"), say(found.resolution) or "–"),
        (say("connector"), say(found.connector) or "–"),
        (say("fits slots for"), ", ".join((found.number, *found.compatible_with))),
        (say("driver"), found.driver.entry_point or say(found.driver.none) or say("has a controller of its own")),
        (say("file"), found.source.rpartition("/")[2]),
    ]
    if found.origin:
        facts.append((say("origin"), say(found.origin)))
    facts += [
        (card.name, versions)
        for card in page.service.views.slots()
        if card.part is not None
        and card.part.part_number == found.number
        and (versions := page.translate(versions_in_words(card.part.hardware, card.part.software)))
    ]
    address = f"{base.rstrip('/')}/library/{found.number}"
    ui.html(
        render("passport", say=say, type=found, facts=facts, picture=picture_of(found), code=qr_svg(address)),
        sanitize=False,
    ).classes("w-full")
    if found.driver.entry_point:
        ui.html(render("wiring", say=say, picture=Markup(wiring_picture(found, say=say))), sanitize=False).classes(
            "w-full"
        )
    _table(
        page,
        "Ports",
        ("Port", "Direction", "Message", "Rate", "Safe value", "Meaning"),
        [
            (
                port.name,
                say(port.direction.value),
                port.type_name,
                f"{page.number(port.rate_hz, 'g')} Hz" if port.rate_hz else say("when it happens"),
                ", ".join(f"{name} = {value_words(value, page.language)}" for name, value in port.safe.items())
                if port.safe
                else "–",
                say(port.description),
            )
            for port in found.ports
        ],
    )
    _table(
        page,
        "Parameters",
        ("Name", "Kind", "Default", "Range", "Unit", "Meaning"),
        [
            (
                one.name,
                one.kind.value,
                value_words(one.default, page.language),
                _range_words(page, one.least, one.most),
                one.unit or "–",
                say(one.description),
            )
            for one in found.parameters
        ],
    )
    _table(
        page,
        "Pins",
        ("Pin", "Name", "Kind", "Meaning"),
        [
            (str(number), pin.name, say(pin.kind.value), say(pin.description))
            for number, pin in enumerate(found.pins, 1)
        ],
    )
    _table(
        page,
        "Which others could fill its slot",
        ("Part type", "Name", "Ports that are lost", "Settings that are lost"),
        [
            (one.number, say(one.name), ", ".join(one.ports) or "–", ", ".join(one.settings) or "–")
            for one in substitutes(found, page.service.views.library)
        ],
    )
    if found.origin and page.may(Right.DESIGN):
        words = page.translate("Forget {number}? A part may describe it anew then.", number=found.number)
        forget = partial(page.act, "forget_type", number=found.number)
        ui.button(page.translate("Forget"), icon="delete", on_click=partial(ask_first, page, words, forget)).props(
            "flat"
        )
    ui.link(page.translate("All part types"), "/library")


def _table(page: Page, title: str, heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> None:
    if rows:
        titles = [page.translate(name) for name in heads]
        ui.html(render("titled_table", title=page.translate(title), heads=titles, rows=rows), sanitize=False).classes(
            "w-full"
        )
