"""The plots page: any numbers of the robot as curves, live and over the recorder's time.

The robot sends what is new ten times a second; `static/plots.js` knows what is looked at, `static/plot_charts.js` draws
it. What is older than the robot's memory is read from the recorder's ring when somebody looks there.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from urllib.parse import parse_qsl, urlencode

from fastapi import Request
from nicegui import ui
from nicegui.events import GenericEventArguments

from msbot.pnp.explain_samples import value_words
from msbot.recording.curves.curve import Figures, Point, WantedCurves, figures_of, thinned
from msbot_agent.text.sentence import as_cell
from msbot_web.html import render
from msbot_web.live_values import HISTORY_S
from msbot_web.page_errors import read_from_browser
from msbot_web.pages.layout import page_frame
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import set_html
from msbot_web.root_path import root
from msbot_web.service import Service
from msbot_xrce.errors import MsbotError
from msbot_xrce.lazy import dataclass

# Saved views of the page Plots: names for addresses, which the person's browser keeps.


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
        self._saved = (
            ui.select([], label=page.translate("Saved views"), on_change=self._open)
            .props("outlined dense options-dense")
            .style("min-width:14rem")
        )
        self._name = ui.input(page.translate("Name of this view")).props("outlined dense maxlength=40")
        ui.button(page.translate("Save"), icon="bookmark_add", on_click=self._save).props("flat")
        ui.button(page.translate("Forget"), icon="bookmark_remove", on_click=self._forget).props("flat")
        ui.on("plots_views", self._know)

    def _know(self, event: GenericEventArguments) -> None:
        found = event.args if isinstance(event.args, dict) else {}
        self._views = {str(name): str(address) for name, address in found.items()}
        self._saved.set_options([*self._views])

    def _save(self) -> None:
        name = str(self._name.value or "").strip()
        if not name:
            ui.notify(self._page.translate("Give the view a name first."), type="warning")
            return
        ui.run_javascript(f"msbotPlots.keep({json.dumps(name)}, {json.dumps(self._address())})")
        self._name.set_value("")
        ui.notify(self._page.translate("{name} is saved in this browser", name=name), type="positive")

    def _forget(self) -> None:
        if self._saved.value:
            ui.run_javascript(f"msbotPlots.keep({json.dumps(str(self._saved.value))}, '')")
            self._saved.set_value(None)

    def _open(self) -> None:
        address = self._views.get(str(self._saved.value or ""), "")
        if address.startswith("/plots?"):
            self._go(address)


SPANS_S = {"10 s": 10.0, "1 min": 60.0, "5 min": 300.0, "10 min": 600.0, "1 h": 3600.0}
"""Those up to five minutes are live."""
SPAN_S = 60.0
MOST_CURVES = 20
PUSH_S = 0.1
MOST_POINTS = 1500
"""Points of a curve that are sent at once."""
LONGEST_S = 30 * 24 * 3600.0


def _head() -> str:
    return (
        f'<link rel="stylesheet" href="{root()}/web/uplot/uPlot.min.css">'
        f'<script src="{root()}/web/uplot/uPlot.iife.min.js"></script>'
        f'<script src="{root()}/web/plot_charts.js"></script><script src="{root()}/web/plots.js"></script>'
    )


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/plots")
    def plots(request: Request, show: str = "", span: float = SPAN_S) -> None:
        with page_frame(service, request, "/plots", "Plots") as page:
            ui.add_head_html(_head())
            wanted = [name for name in show.split(",") if name]
            _Plots(page, wanted, span if span in SPANS_S.values() else SPAN_S)


@dataclass(slots=True)
class _View:
    """What is looked at."""

    names: list[str]
    span_s: float
    live: bool = True
    from_s: float = 0.0
    """Of a view that stands still: seconds of the robot's clock."""
    to_s: float = 0.0

    def address(self, awaited: Sequence[str]) -> str:
        """The page with these curves and those that nobody has measured yet, at whatever time; the time slider adds it."""
        return f"/plots?{urlencode({'show': ','.join([*self.names, *awaited]), 'span': f'{self.span_s:g}'})}"


class _Plots:
    """Saved views of the page Plots: names for addresses, which the person's browser keeps."""

    def __init__(self, page: Page, wanted: Sequence[str], span_s: float) -> None:
        self._page = page
        self._curves = page.service.views.curves
        self._epoch_s = time.time() - page.service.now()
        """When the robot's clock was 0."""
        self._zone_s = (datetime.now().astimezone().utcoffset() or datetime.min - datetime.min).total_seconds()
        known = self._curves.known()
        self._wanted = WantedCurves(wanted, MOST_CURVES)
        self._view = _View(self._wanted.found(known) if wanted else self._first(known), span_s)
        self._sent: dict[str, float] = {}
        self._past: dict[str, tuple[Sequence[Point], Figures | None]] = {}
        """What was read from the recorder for a view that stands still."""
        self._is_seen = True
        self._make()
        ui.run_javascript(f"msbotPlots.begin({self._setup(self._points())})")
        for event, handler in (
            ("plots_window", self._looked),
            ("plots_live", self._go_live),
            ("plots_seen", self._seen),
        ):
            ui.on(event, handler)
        page.every(PUSH_S, self._push)
        page.every_look(self._show_figures)
        page.every_look(self._show_known)
        if page.time_slider is not None:
            page.time_slider.on_change(self._other_moment)

    @staticmethod
    def _first(known: Mapping[str, object]) -> list[str]:
        """What is shown to somebody who has not chosen anything: the first port's."""
        return [name for name in known if "." in name and ":" not in name][:1] or [*known][:1]

    # What is on the page.

    def _make(self) -> None:
        page = self._page
        with ui.element("div").classes("panel"):
            self._choice = (
                ui.select(
                    [*self._curves.known()],
                    multiple=True,
                    value=list(self._view.names),
                    label=page.translate("Curves"),
                    with_input=True,
                    on_change=self._chosen,
                )
                .props(f"use-chips outlined dense max-values={MOST_CURVES}")
                .classes("w-full plot-choice")
            )
            with ui.element("div").classes("row spread").style("margin-top:.6rem"):
                word = next(word for word, span in SPANS_S.items() if span == self._view.span_s)
                self._span = ui.toggle([*SPANS_S], value=word, on_change=self._span_chosen).props(
                    f'no-caps aria-label="{page.translate("Time")}"'
                )
                with ui.element("div").classes("row"):
                    self._button("chevron_left", page.translate("Earlier"), "msbotPlots.pan(-.25)")
                    self._button("chevron_right", page.translate("Later"), "msbotPlots.pan(.25)")
                    self._button("zoom_in", page.translate("Zoom in"), "msbotPlots.zoom(.5)")
                    self._button("zoom_out", page.translate("Zoom out"), "msbotPlots.zoom(2)")
                    self._pause = self._button("pause", page.translate("Pause"), "msbotPlots.pause()")
                    self._live = ui.button(page.translate("Live"), icon="play_arrow", on_click=self._go_live)
            self._state = ui.html("", sanitize=False).props("role=status")
            with (
                ui.element("div")
                .classes("plot-area")
                .props(
                    f'tabindex=0 role=group aria-label="{page.translate("Curves; their numbers are in the table below")}"'
                )
            ):
                self._host = ui.element("div").classes("w-full plot-charts").props("aria-hidden=true")
                ui.html('<div class="plot-cursor" aria-hidden="true"></div>', sanitize=False)
            ui.label(
                page.translate(
                    "Wheel: zoom; drag: earlier and later. With the keyboard: arrows move the cursor, with Shift the time, "
                    "+ and - zoom, Space pauses and continues."
                )
            ).classes("soft hide-phone").style("font-size:.82rem")
        with ui.element("div").classes("panel"):
            self._figures = ui.html("", sanitize=False).classes("w-full scroll").props("tabindex=0 id=ms-plot-figures")
            with ui.element("div").classes("row").style("margin-top:.6rem"):
                ui.button(page.translate("Picture (PNG)"), icon="image").props("flat").on(
                    "click", js_handler="() => msbotPlots.save()"
                )
                ui.button(page.translate("Table (CSV)"), icon="download", on_click=self._table).props("flat")
                SavedViews(page, lambda: self._view.address(self._wanted.awaited), self._open_view)
        self._show_state()

    def _button(self, icon: str, words: str, script: str) -> ui.button:
        button = ui.button(icon=icon).props("flat round dense").on("click", js_handler=f"() => {script}")
        button.props["aria-label"] = button.props["title"] = words
        return button

    def _show_known(self) -> None:
        found = [*self._curves.known()]
        known = [*found, *(name for name in self._view.names if name not in found)]  # of parts that are gone
        more = self._wanted.found(found, self._view.names)
        if more:
            self._view.names = [*self._view.names, *more]
        if more or list(self._choice.options) != known:
            self._choice.set_options(known, value=list(self._view.names))
        if more:
            self._page.show_when_ready(self._show_window())

    def _show_state(self, words: str = "") -> None:
        view = self._view
        if not words and not view.live:
            begin, end = (
                datetime.fromtimestamp(self._epoch_s + at).strftime("%H:%M:%S") for at in (view.from_s, view.to_s)
            )
            words = self._page.translate("The past: {begin} to {end}", begin=begin, end=end)
        if not words and self._wanted.awaited:
            words = self._page.translate("Not measured so far: {names}", names=", ".join(self._wanted.awaited))
        set_html(self._state, render("plot_state", words=words))
        self._pause.set_visibility(view.live)
        self._live.set_visibility(not view.live)

    def _show_figures(self) -> None:
        rows = []
        for place, name in enumerate(self._view.names):
            figures = self._figures_of(name)
            numbers = (
                ["–"] * 3
                if figures is None
                else [self._page.number(value, ".5g") for value in (figures.mean, figures.least, figures.most)]
            )
            count = 0 if figures is None else figures.count
            rows.append((place, name, numbers, self._page.number(count), self._unit(name)))
        set_html(self._figures, render("plot_figures", say=self._page.translate, rows=rows))

    def _figures_of(self, name: str) -> Figures | None:
        if not self._view.live:
            return self._past.get(name, ((), None))[1]
        after = self._page.service.now() - self._view.span_s
        return figures_of(
            [value for at, value in self._curves.points_after(name, after) if at > after or self._holds(name)]
        )

    def _unit(self, name: str) -> str:
        facts = self._curves.known().get(name)
        return "" if facts is None else facts.unit

    def _holds(self, name: str) -> bool:
        facts = self._curves.known().get(name)
        return facts is not None and facts.holds

    # What the browser is sent.

    def _ms(self, at: float) -> float:
        """A time of the robot's clock as the browser has it."""
        return round((at + self._epoch_s + self._zone_s) * 1e3, 1)

    def _clock_s(self, ms: float) -> float:
        """The reverse."""
        return ms / 1e3 - self._epoch_s - self._zone_s

    def _pairs(self, points: Sequence[Point]) -> list[list[float]]:
        return [[self._ms(at), value] for at, value in points]

    def _points(self) -> dict[str, Sequence[Point]]:
        """All that is seen at present."""
        if not self._view.live:
            return {name: self._past.get(name, ((), None))[0] for name in self._view.names}
        now = self._page.service.now()
        found: dict[str, Sequence[Point]] = {}
        for name in self._view.names:
            points = self._curves.points_after(name, now - self._view.span_s)
            self._sent[name] = points[-1][0] if points else now - self._view.span_s
            found[name] = thinned(points, MOST_POINTS)
        return found

    def _setup(self, points: Mapping[str, Sequence[Point]]) -> str:
        view = self._view
        curves = [
            {"name": name, "unit": self._unit(name), "holds": self._holds(name), "points": self._pairs(points[name])}
            for name in view.names
        ]
        setup = {
            "host": self._host.html_id,
            "curves": curves,
            "now": self._ms(self._page.service.now()),
            "live": view.live,
            "span": view.span_s * 1e3,
            "from": self._ms(view.from_s),
            "to": self._ms(view.to_s),
            "address": view.address(self._wanted.awaited),
            "words": {
                "latest": self._page.translate("Latest"),
                "no_unit": self._page.translate("no unit"),
                "remove": self._page.translate("Remove {name}", name="{name}"),
            },
        }
        return json.dumps(setup)

    def _show(self) -> None:
        """Begin anew: other curves, another time."""
        self._show_state()
        self._show_figures()
        ui.run_javascript(f"msbotPlots.show({self._setup(self._points())})")

    def _push(self) -> None:
        """What has come in the last tenth of a second."""
        if not self._view.live or not self._is_seen:
            return
        news = []
        for place, name in enumerate(self._view.names):
            after = self._sent.get(name, 0.0)
            points = [point for point in self._curves.points_after(name, after) if point[0] > after]
            if points:
                self._sent[name] = points[-1][0]
                news.append([place, self._pairs(thinned(points, MOST_POINTS))])
        if news:
            ui.run_javascript(f"msbotPlots.add({json.dumps(news)})")

    # What a person does.

    async def _chosen(self) -> None:
        names = [str(name) for name in self._choice.value or []][:MOST_CURVES]
        if names != self._view.names:
            self._view.names, self._wanted = names, WantedCurves((), 0)  # who chooses has seen what is there
            await self._show_window()

    async def _span_chosen(self) -> None:
        self._view.span_s = SPANS_S[str(self._span.value)]
        if self._view.span_s <= HISTORY_S:
            self._go_live()
            return
        now = self._page.service.now()
        self._view.live, self._view.from_s, self._view.to_s = False, now - self._view.span_s, now
        self._note_moment()
        await self._show_window()

    async def _looked(self, event: GenericEventArguments) -> None:
        """A person has zoomed, gone back or stopped."""
        now = self._page.service.now()
        with read_from_browser():
            end = min(self._clock_s(float(event.args["to"])), now)
            begin = max(self._clock_s(float(event.args["from"])), end - LONGEST_S)
        if begin >= end:
            return
        self._view.live, self._view.from_s, self._view.to_s = False, begin, end
        self._note_moment()
        await self._show_window()

    def _other_moment(self, at_s: float | None) -> None:
        """The time slider shows another moment: the window ends there."""
        if at_s is None:
            self._live_again()
            return
        end = at_s - self._epoch_s
        self._view.live, self._view.from_s, self._view.to_s = False, end - self._view.span_s, end
        self._page.show_when_ready(self._show_window())

    def _note_moment(self) -> None:
        """Have the time slider follow."""
        if self._page.time_slider is not None:
            self._page.time_slider.note(None if self._view.live else self._view.to_s + self._epoch_s)

    def _go_live(self) -> None:
        self._live_again()
        self._note_moment()

    def _live_again(self) -> None:
        if self._view.span_s > HISTORY_S:
            self._view.span_s = SPAN_S
            self._span.set_value("1 min")
        self._view.live = True
        self._past = {}
        self._show()

    async def _show_window(self) -> None:
        """Show the window that is looked at, from memory or, if it is older than that, from the recorder."""
        view, now = self._view, self._page.service.now()
        if view.live:
            self._show()
            return
        if view.from_s < now - HISTORY_S:
            asked = (view.from_s, view.to_s, list(view.names))
            self._show_state(self._page.translate("Reading what the recorder has ..."))
            try:
                self._past = await self._read(*asked)
            except MsbotError as error:
                self._past = {}
                self._show_state(self._page.translate(str(error)))
                return
            if view.live or asked != (view.from_s, view.to_s, view.names):
                return  # somebody has gone on meanwhile
        else:
            self._past = {name: self._piece(name) for name in view.names}
        self._show()

    def _piece(self, name: str) -> tuple[Sequence[Point], Figures | None]:
        """A window of what is in memory."""
        begin, end = self._view.from_s, self._view.to_s
        found = self._curves.points_after(name, begin)
        points = [(max(at, begin), value) for at, value in found if at <= end]
        return thinned(points, MOST_POINTS), figures_of([value for _, value in points])

    async def _read(
        self, from_s: float, to_s: float, names: list[str]
    ) -> dict[str, tuple[Sequence[Point], Figures | None]]:
        read = await self._page.service.past.curves(names, from_s + self._epoch_s, to_s + self._epoch_s)
        return {
            curve.name: ([(at - self._epoch_s, value) for at, value in curve.points], read.figures.get(curve.name))
            for curve in read.curves
        }

    def _seen(self, event: GenericEventArguments) -> None:
        """The page is looked at again, or no more: then nothing is sent."""
        self._is_seen = bool(event.args)
        if self._is_seen and self._view.live:
            self._show()

    async def _table(self) -> None:
        view, now = self._view, self._page.service.now()
        begin, end = (now - view.span_s, now) if view.live else (view.from_s, view.to_s)
        lines = ["time,curve,value,unit"]
        for name in view.names:
            if view.live or begin >= now - HISTORY_S:
                points: Sequence[Point] = [point for point in self._curves.points_after(name, begin) if point[0] <= end]
            else:
                points = self._past.get(name, ((), None))[0]
            quoted = as_cell(name).replace('"', '""')
            unit = as_cell(self._unit(name)).replace('"', '""')
            lines += [
                f'{_iso(at + self._epoch_s)},"{quoted}",{value_words(float(value))},"{unit}"' for at, value in points
            ]
        ui.download.content("\r\n".join([*lines, ""]), "plots.csv")

    def _open_view(self, address: str) -> None:
        found = dict(parse_qsl(address.removeprefix("/plots?")))
        word = next((word for word, span in SPANS_S.items() if f"{span:g}" == found.get("span")), "1 min")
        self._wanted = WantedCurves(found.get("show", "").split(","), MOST_CURVES)
        self._view.names = self._wanted.found(self._curves.known())
        self._choice.set_value(list(self._view.names))
        self._page.show_when_ready(self._show_window())
        self._span.set_value(word)


def _iso(at_s: float) -> str:
    return datetime.fromtimestamp(at_s).isoformat(timespec="milliseconds")
