"""The timeline: the states of every slot as bars over time, with their reasons; and the values of any port over time."""

from __future__ import annotations

import json

from fastapi import Request
from nicegui import ui

from msbot.lab.curves.curve import Curve
from msbot.web.api.models import TimelineLane
from msbot.web.html import Markup, render
from msbot.web.pages.layout import Page, page_frame
from msbot.web.pages.page_elements import heading, set_html
from msbot.web.service import Service
from msbot.web.svg.plots import bars_svg, curve_svg, curves_csv

SPANS_S = {"1 min": 60.0, "5 min": 300.0, "30 min": 1800.0, "2 h": 7200.0}
RANGES_S = {"10 s": 10.0, "1 min": 60.0, "5 min": 300.0}
"""Of values; as long as they are kept."""
MOST_CURVES = 6
EVENTS = 100


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/timeline")
    def timeline(request: Request) -> None:
        with page_frame(service, request, "/timeline", "Timeline") as page:
            _bars(page)
            _Plot(page)


def _bars(page: Page) -> None:
    with ui.element("div").classes("panel"):
        with ui.element("div").classes("row spread"):
            zoom = _choice(page, SPANS_S, "5 min")
            with ui.element("div").classes("row"):
                picture = ui.button(page.say("Picture (SVG)"), icon="image").props("flat")
                data = ui.button(page.say("Data (JSON)"), icon="download").props("flat")
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
    rows = [
        (f"{span.begin_age_s:.0f} s", slot, page.say(span.state), page.say(span.reason))
        for span, slot in spans[:EVENTS]
    ]
    return render("table", heads=[page.say(title) for title in ("Ago", "Slot", "State", "Reason")], rows=rows)


class _Plot:
    """Curves of the numbers of any port: five minutes at full rate, the range as chosen, with a cursor."""

    def __init__(self, page: Page) -> None:
        self._page = page
        with ui.element("div").classes("panel"):
            with ui.element("div").classes("row spread"):
                heading(page.say("Values over time"))
                with ui.element("div").classes("row"):
                    self._range = _choice(page, RANGES_S, "1 min")
                    ui.button(page.say("Picture (SVG)"), icon="image", on_click=self._picture).props("flat")
                    ui.button(page.say("Table (CSV)"), icon="download", on_click=self._table).props("flat")
            known = self._choices()
            self._wanted = ui.select(known, multiple=True, value=known[:1], label=page.say("Fields")).props(
                f"use-chips outlined dense max-values={MOST_CURVES}"
            )
            self._wanted.classes("w-full")
            with ui.element("div").classes("plot w-full scroll").props("tabindex=0"):
                self._shown = ui.html("", sanitize=False).classes("w-full")
                ui.html('<div class="cursor" aria-hidden="true"></div>', sanitize=False)
        ui.run_javascript("msbotCursor()")
        self._range.on_value_change(self._show)
        self._wanted.on_value_change(self._show)
        page.every_look(self._show)

    def _choices(self) -> list[str]:
        return [
            f"{topic.topic} · {name}"
            for topic in self._page.service.views.topics()
            for name, value in topic.fields.items()
            if isinstance(value, int | float)
        ]

    def _curves(self) -> list[Curve]:
        views = self._page.service.views
        types = {topic.topic: topic.type_name for topic in views.topics()}
        curves = []
        for choice in list(self._wanted.value or [])[:MOST_CURVES]:
            topic, _, field = str(choice).rpartition(" · ")
            unit = views.units(types.get(topic, "")).get(field, "")
            curves.append(Curve(str(choice), views.live.series(topic, field), unit))
        return curves

    def _draw(self) -> Markup:
        return curve_svg(
            self._curves(), RANGES_S[str(self._range.value)], self._page.service.now(), self._page.language
        )

    def _show(self) -> None:
        found = self._choices()
        if list(self._wanted.options) != found:
            chosen = [name for name in self._wanted.value or [] if name in found]
            self._wanted.set_options(found, value=chosen or found[:1])
        set_html(self._shown, self._draw())

    def _picture(self) -> None:
        ui.download.content(str(self._draw()), "values.svg")

    def _table(self) -> None:
        ui.download.content(curves_csv(self._curves(), self._page.service.now()), "values.csv")


def _choice(page: Page, spans: dict[str, float], value: str) -> ui.toggle:
    return ui.toggle(list(spans), value=value).props(f'no-caps aria-label="{page.say("Zoom")}"')
