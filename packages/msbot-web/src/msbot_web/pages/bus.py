"""The bus page: load, and every frame with what it says; a click takes a frame apart down to its fields."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Callable
from functools import partial

from fastapi import Request
from nicegui import ui
from nicegui.events import GenericEventArguments

from msbot_agent.explain.frame_picture import frame_picture
from msbot_agent.link.can.protocol import parse_frame, wire_bits
from msbot_web.html import render
from msbot_web.models.bus_models import BusFigures, FrameLine
from msbot_web.page_errors import read_from_browser
from msbot_web.pages.layout import page_frame
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import set_html
from msbot_web.robot_view import RobotView
from msbot_web.service import Service
from msbot_xrce.errors import LocalProtocolError
from msbot_xrce.lazy import dataclass

ROWS = 60
"""Rows that are shown; the counters beside them count every frame."""
KEPT_ROWS = 2000
"""Rows that are filtered."""
COLOURS = 12


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/bus")
    def bus(request: Request, find: str = "") -> None:
        with page_frame(service, request, "/bus", "Bus") as page:
            _load(page)
            _Table(page, find)


def _load(page: Page) -> None:
    shown = ui.html("", sanitize=False).classes("w-full")

    def show() -> None:
        bus = page.sight.bus()
        share = min(bus.load_percent, 100.0)
        colour = "good" if share < 50 else "warn" if share < 80 else "bad"
        set_html(
            shown,
            render(
                "bus_load",
                say=page.translate,
                number=page.number,
                counted=page.language.count,
                bus=bus,
                is_past=page.is_past,
                share=share,
                colour=colour,
            ),
        )

    page.every_look(show)


class _Table:
    """The frame table: the newest rows, or those of the moment when it was paused."""

    def __init__(self, page: Page, find: str) -> None:
        self._page = page
        self._rows: list[FrameLine] = []
        with ui.element("div").classes("panel"):
            with ui.element("div").classes("row").style("margin-bottom:.5rem"):
                self._paused = ui.switch(page.translate("Pause"), on_change=self._pause)
                self._find = ui.input(page.translate("Filter"), value=find, placeholder="node 3, BEACON, 103").props(
                    "dense clearable outlined"
                )
                self._find.on_value_change(lambda: self._show(force=True))
                for title, name, lines in (
                    ("Table (CSV)", "bus.csv", lambda sight: sight.frames_as_csv()),
                    ("candump", "bus.log", lambda sight: sight.frames_as_candump()),
                ):
                    ui.button(
                        page.translate(title), icon="download", on_click=partial(_download, page, name, lines)
                    ).props("flat")
                ui.link(page.translate("Quiz: take bytes and frames apart"), "/learn/quiz")
            with ui.element("div").classes("ms-split"):
                with ui.element("div").classes("scroll").props("tabindex=0"):
                    self._table = (
                        ui.html("", sanitize=False)
                        .classes("w-full")
                        .on("mousedown", self._clicked, js_handler=_ROW_CLICKED)
                        .on("keydown.enter", self._clicked, js_handler=_ROW_CLICKED)
                    )
                self._detail = ui.html("", sanitize=False).classes("ms-side").props("aria-live=polite")
        self._levels = ui.html("", sanitize=False).classes("w-full")
        page.every_look(self._show)
        if page.time_slider is not None:
            page.time_slider.on_change(self._other_moment)

    def _other_moment(self, at_s: float | None) -> None:  # noqa: ARG002 - the sight has it
        """What was paused, or taken apart, is of another time."""
        self._rows = []
        self._paused.set_value(False)
        self._detail.set_content("")
        self._levels.set_content("")

    def _pause(self) -> None:
        """Keep what the server still has of the past, for filtering at leisure."""
        if self._paused.value:
            self._rows = self._page.frame_lines(KEPT_ROWS)
        self._show(force=True)

    def _show(self, *, force: bool = False) -> None:
        if self._paused.value and self._rows and not force:
            return
        words = str(self._find.value or "").casefold().split()
        if not self._paused.value:
            self._rows = self._page.frame_lines(KEPT_ROWS if words else ROWS)
        rows = [row for row in self._rows if all(word in _text_of(row) for word in words)][-ROWS:]
        heads = [self._page.translate(title) for title in ("No.", "Age", "Sender", "Frame", "What it says")]
        lines = [(row, _colour_of(row)) for row in reversed(rows)]
        # Rows that stand still can be reached by the keyboard; others would lose it twice a second.
        set_html(
            self._table,
            render(
                "frames",
                say=self._page.translate,
                number=self._page.number,
                heads=heads,
                rows=lines,
                is_still=bool(self._paused.value) or self._page.is_past,
            ),
        )

    def _clicked(self, event: GenericEventArguments) -> None:
        with read_from_browser():
            number = int(event.args)
        # The row may have left the table between the click and now.
        shown = next((row for row in self._rows if row.number == number), None)
        found = None if shown else self._page.sight.frame_line(number)
        row = shown or (found and self._page.private_octets().frames([found])[0])
        if row is None:
            return
        identifier, _, data = row.text.strip().partition("  ")
        levels = levels_of(row, self._page.sight.bus())
        self._detail.set_content(
            render(
                "frame",
                say=self._page.translate,
                row=row,
                identifier=identifier,
                data=data.strip(),
                has_levels=bool(levels),
            )
        )
        self._levels.set_content(render("frame_levels", say=self._page.translate, row=row, levels=levels))


@dataclass(frozen=True, slots=True)
class Levels:
    """A frame as an oscilloscope shows it."""

    picture: str
    """SVG, base64: its styles must not reach the page."""
    bits: int
    stuff_bits: int


def levels_of(row: FrameLine, bus: BusFigures) -> Levels | None:
    """CAN-H and CAN-L of a frame; None: it cannot be drawn, or nobody knows how fast its parts were."""
    try:
        frame = parse_frame(row.notation)
        bits = wire_bits(frame)
    except (ValueError, LocalProtocolError):  # an error frame has no bits of its own
        return None
    if not bus.bitrate or (frame.brs and not bus.data_bitrate):
        return None
    picture = frame_picture(frame, bitrate=bus.bitrate, data_bitrate=bus.data_bitrate or None)
    return Levels(b64encode(picture.encode()).decode(), len(bits), sum(bit.stuff for bit in bits))


_ROW_CLICKED = (
    """(event) => { const row = event.target.closest('tr[data-number]'); if (row) emit(Number(row.dataset.number)); }"""
)


def _text_of(row: FrameLine) -> str:
    return (
        f"node {row.node} {row.sender} {row.text} {' '.join(row.plain or row.about)} {' '.join(row.words)}".casefold()
    )


def _colour_of(row: FrameLine) -> str:
    """The colour of a row's edge: one for each part's address."""
    return f"hsl({row.node * 360 // COLOURS % 360} 60% 50%)" if row.node else "transparent"


def _download(page: Page, name: str, lines: Callable[[RobotView], str]) -> None:
    ui.download.content(page.private_octets().lines(lines(page.sight)), name)
