"""The timeline: the states of every slot as bars over time, with their reasons; zoom, export, and plots of values."""

from __future__ import annotations

import json
from html import escape

from fastapi import Request
from nicegui import ui

from msbot.web.models import Lane
from msbot.web.pages.layout import Page, page_frame
from msbot.web.plots import bars_svg, curve_svg
from msbot.web.service import Service

SPANS_S = {"1 min": 60.0, "5 min": 300.0, "30 min": 1800.0, "2 h": 7200.0}


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/timeline")
    def timeline(request: Request) -> None:
        with page_frame(service, request, "/timeline", "Timeline") as page:
            _bars(page)
            _plot(page)


def _bars(page: Page) -> None:
    with ui.element("div").classes("panel"):
        with ui.element("div").classes("row spread"):
            zoom = ui.toggle(list(SPANS_S), value="5 min").props(f'no-caps aria-label="{escape(page.say("Zoom"))}"')
            with ui.element("div").classes("row"):
                ui.button(
                    page.say("Picture (SVG)"), icon="image", on_click=lambda: _save_svg("timeline.svg", draw())
                ).props("flat")
                ui.button(
                    page.say("Data (JSON)"),
                    icon="download",
                    on_click=lambda: ui.download.content(
                        json.dumps([lane.model_dump() for lane in page.service.views.timeline()], indent=1),
                        "timeline.json",
                    ),
                ).props("flat")
        shown = ui.html("", sanitize=False).classes("w-full scroll from-right")
        events = ui.html("", sanitize=False).classes("w-full scroll").style("max-height:18rem;margin-top:1rem")

    def draw() -> str:
        return bars_svg(page.service.views.timeline(), SPANS_S[str(zoom.value)], page.say)

    def show() -> None:
        content = draw()
        if shown.content != content:
            shown.set_content(content)
        rows = _event_rows(page, page.service.views.timeline(), SPANS_S[str(zoom.value)])
        if events.content != rows:
            events.set_content(rows)

    zoom.on_value_change(show)
    page.every_look(show)


def _event_rows(page: Page, lanes: list[Lane], span_s: float) -> str:
    spans = [(span, lane.slot) for lane in lanes for span in lane.spans if span.begin_age_s <= span_s]
    spans.sort(key=lambda pair: pair[0].begin_age_s)
    rows = "".join(
        f"<tr><td class='num'>{span.begin_age_s:.0f} s</td><td><b>{escape(slot)}</b></td>"
        f"<td>{escape(page.say(span.state))}</td><td>{escape(span.reason)}</td></tr>"
        for span, slot in spans[:100]
    )
    head = "".join(f"<th>{escape(page.say(title))}</th>" for title in ("Ago", "Slot", "State", "Reason"))
    return f'<table class="ms-table stack"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>'


def _plot(page: Page) -> None:
    """Curves of any numeric field of any topic."""

    def choices() -> list[str]:
        found = []
        for topic in page.service.views.topics():
            for name, value in topic.fields.items():
                if isinstance(value, int | float):
                    found.append(f"{topic.topic} · {name}")
        return found

    with ui.element("div").classes("panel"):
        with ui.element("div").classes("row spread"):
            ui.html(f"<h2>{escape(page.say('Values over time'))}</h2>", sanitize=False)
            save = ui.button(page.say("Picture (SVG)"), icon="image").props("flat")
        known = choices()
        wanted = ui.select(known, multiple=True, value=known[:1], label=page.say("Fields")).props(
            "use-chips outlined dense"
        )
        wanted.classes("w-full")
        shown = ui.html("", sanitize=False).classes("w-full scroll")
        save.on_click(lambda: _save_svg("values.svg", shown.content))

    def show() -> None:
        found = choices()
        if list(wanted.options) != found:
            wanted.set_options(found, value=[name for name in wanted.value or [] if name in found] or found[:1])
        curves = {}
        for choice in wanted.value or []:
            topic, _, field = str(choice).partition(" · ")
            curves[str(choice)] = page.service.views.live.series(topic, field)
        content = curve_svg(curves, page.say)
        if shown.content != content:
            shown.set_content(content)

    page.every_look(show)


def _save_svg(name: str, svg: str) -> None:
    if "xmlns" not in svg:
        svg = svg.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1)
    ui.download.content(svg, name)
