"""The part library as a catalogue with search; every entry has a page with pins, ports, and a code to stick on the part."""

from __future__ import annotations

from html import escape

from fastapi import Request
from nicegui import ui

from msbot.config import PartType
from msbot.web.pages.layout import Page, page_frame
from msbot.web.passport import picture_of, qr_svg
from msbot.web.service import Service


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
                ui.label(page.say("There is no part type {number} in the library.", number=number))
                ui.link(page.say("Library"), "/library")
            else:
                _entry(page, found, str(request.base_url))


def _catalogue(page: Page, search: str) -> None:
    find = ui.input(page.say("Search"), value=search, placeholder=page.say("servo, light, I2C …")).props(
        "outlined clearable autofocus"
    )
    find.classes("w-full")
    grid = ui.html("", sanitize=False).classes("w-full")

    def show() -> None:
        cards = []
        for line in page.service.views.types(str(find.value or "")):
            found = page.service.views.library.get(line.number)
            picture = "" if found is None else picture_of(found)
            cards.append(
                f'<a class="slot" style="text-decoration:none;color:inherit;border-left-color:var(--accent)" '
                f'href="/library/{escape(line.number, quote=True)}"><div class="head">'
                f'<div style="width:72px;flex:none">{picture}</div><div style="min-width:0"><div class="title">{escape(line.name)}</div>'
                f'<div class="soft mono">{escape(line.number)}</div><div class="soft">{escape(line.manufacturer)}</div></div></div>'
                f'<div class="reason">{escape(line.description)}</div>'
                f'<div class="soft" style="font-size:.82rem">{escape(", ".join(line.ports))}</div></a>'
            )
        count = page.say("{count} part types", count=len(cards))
        grid.set_content(
            f'<p class="soft" aria-live="polite" style="margin-bottom:.7rem">{escape(count)}</p><div class="grid">{"".join(cards)}</div>'
        )

    find.on_value_change(show)
    show()


def _entry(page: Page, found: PartType, base: str) -> None:
    say = page.say
    facts = [
        (say("part number"), found.number),
        (say("manufacturer"), found.manufacturer),
        (say("supply"), str(found.supply or found.specification or "–")),
        (say("resolution"), found.resolution or "–"),
        (say("connector"), found.connector or "–"),
        (say("fits slots for"), ", ".join((found.number, *found.compatible_with))),
        (say("driver"), found.driver or say("has a controller of its own")),
        (say("file"), found.source.rpartition("/")[2]),
    ]
    rows = "".join(f'<tr><td class="soft">{escape(name)}</td><td>{escape(value)}</td></tr>' for name, value in facts)
    address = f"{base.rstrip('/')}/library/{found.number}"
    ui.html(
        f'<div class="panel"><div class="row" style="gap:1.5rem;align-items:flex-start"><div style="width:180px">{picture_of(found)}</div>'
        f'<div style="flex:1;min-width:min(18rem,100%)"><h2 style="font-size:1.4rem">{escape(found.name)}</h2>'
        f'<p class="soft">{escape(found.description)}</p><table class="ms-table">{rows}</table></div>'
        f'<div style="text-align:center">{qr_svg(address)}<div class="soft" style="font-size:.8rem">{escape(say("stick this on the part"))}'
        f"</div></div></div></div>",
        sanitize=False,
    ).classes("w-full")
    _table(page, "Ports", ("Port", "Direction", "Message", "Rate", "Safe value", "Meaning"), [
        (port.name, say(port.direction.value), port.type_name, f"{port.rate_hz:g} Hz" if port.rate_hz else say("when it happens"),
         ", ".join(f"{name} = {value}" for name, value in port.safe.items()) if port.safe else "–", port.description)
        for port in found.ports
    ])  # fmt: skip
    _table(page, "Parameters", ("Name", "Kind", "Default", "Range", "Unit", "Meaning"), [
        (one.name, one.kind.value, str(one.default),
         "–" if one.least is None and one.most is None else f"{one.least if one.least is not None else ''} … {one.most if one.most is not None else ''}",
         one.unit or "–", one.description)
        for one in found.parameters
    ])  # fmt: skip
    _table(page, "Pins", ("Pin", "Name", "Kind", "Meaning"), [
        (str(number), pin.name, pin.kind.value, pin.description) for number, pin in enumerate(found.pins, 1)
    ])  # fmt: skip
    ui.link(page.say("All part types"), "/library")


def _table(page: Page, title: str, heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> None:
    if not rows:
        return
    head = "".join(f"<th>{escape(page.say(name))}</th>" for name in heads)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    ui.html(
        f'<div class="panel scroll"><h2>{escape(page.say(title))}</h2><table class="ms-table"><thead><tr>{head}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>",
        sanitize=False,
    ).classes("w-full")
