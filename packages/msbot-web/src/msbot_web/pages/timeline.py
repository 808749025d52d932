"""The timeline: the states of every slot as bars over time, with their reasons."""

from __future__ import annotations

import json

from fastapi import Request
from nicegui import ui

from msbot_web.html import Markup, render
from msbot_web.models.robot_models import TimelineLane
from msbot_web.pages.layout import page_frame
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import set_html
from msbot_web.service import Service
from msbot_web.svg.wiring_graph import bars_svg

SPANS_S = {"1 min": 60.0, "5 min": 300.0, "30 min": 1800.0, "2 h": 7200.0}
EVENTS = 100


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/timeline")
    def timeline(request: Request) -> None:
        with page_frame(service, request, "/timeline", "Timeline") as page:
            _bars(page)


def _bars(page: Page) -> None:
    with ui.element("div").classes("panel"):
        with ui.element("div").classes("row spread"):
            zoom = _choice(page, SPANS_S, "5 min")
            with ui.element("div").classes("row"):
                picture = ui.button(page.translate("Picture (SVG)"), icon="image").props("flat")
                data = ui.button(page.translate("Data (JSON)"), icon="download").props("flat")
        shown = ui.html("", sanitize=False).classes("w-full")
        events = (
            ui.html("", sanitize=False)
            .classes("w-full scroll")
            .props("tabindex=0")
            .style("max-height:18rem;margin-top:1rem")
            .props("tabindex=0")
        )

    def lanes() -> list[TimelineLane]:
        return page.service.views.timeline()

    def show() -> None:
        span_s, found = SPANS_S[str(zoom.value)], lanes()
        both = [bars_svg(found, span_s, page.language, is_narrow=is_narrow) for is_narrow in (False, True)]
        set_html(shown, Markup("").join(both))
        set_html(events, _event_rows(page, found, span_s))

    picture.on_click(
        lambda: ui.download.content(str(bars_svg(lanes(), SPANS_S[str(zoom.value)], page.language)), "timeline.svg")
    )
    data.on_click(
        lambda: ui.download.content(json.dumps([lane.model_dump() for lane in lanes()], indent=1), "timeline.json")
    )
    zoom.on_value_change(show)
    page.every_look(show)


def _event_rows(page: Page, lanes: list[TimelineLane], span_s: float) -> Markup:
    spans = [(span, lane.slot) for lane in lanes for span in lane.spans if span.begin_age_s <= span_s]
    spans.sort(key=lambda pair: pair[0].begin_age_s)
    rows: list[tuple[str, ...]] = [
        (f"{span.begin_age_s:.0f} s", slot, page.translate(span.state), page.translate(span.reason))
        for span, slot in spans[:EVENTS]
    ] or [(page.translate("Nothing has changed in this time."),)]
    return render("table", heads=[page.translate(title) for title in ("Ago", "Slot", "State", "Reason")], rows=rows)


def _choice(page: Page, spans: dict[str, float], value: str) -> ui.toggle:
    return ui.toggle(list(spans), value=value).props(f'no-caps aria-label="{page.translate("Zoom")}"')
