"""The bus page: load, and every frame with what it says; a click takes a frame apart down to its fields."""

from __future__ import annotations

from html import escape

from fastapi import Request
from nicegui import ui
from nicegui.events import GenericEventArguments

from msbot.web.models import FrameLine
from msbot.web.pages.layout import Page, page_frame
from msbot.web.service import Service

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
        bus = page.service.views.bus()
        if not bus.watched:
            content = f'<div class="panel">{escape(page.say("This robot has no CAN bus that could be watched."))}</div>'
        else:
            share = min(bus.load_percent, 100.0)
            colour = "good" if share < 50 else "warn" if share < 80 else "bad"
            content = (
                f'<div class="panel"><div class="row spread"><b>{escape(bus.name)} · {bus.bitrate // 1000} kbit/s</b>'
                f'<span class="num">{bus.frames:,} {escape(page.say("frames"))} · {bus.frames_per_second:.0f}/s · '
                f"{bus.errors} {escape(page.say('errors'))}</span></div>"
                f'<div role="meter" aria-valuenow="{share:.1f}" aria-valuemin="0" aria-valuemax="100" '
                f'aria-label="{escape(page.say("Load"))}" style="margin-top:.5rem;height:1.1rem;border-radius:99px;'
                f'background:var(--idle-soft);overflow:hidden"><div style="width:{max(share, 0.5):.1f}%;height:100%;'
                f'background:var(--{colour})"></div></div><div class="soft num">{escape(page.say("load"))} {share:.1f} %</div></div>'
            )
        if shown.content != content:
            shown.set_content(content)

    page.every_look(show)


class _Table:
    """The frame table: the newest rows, or those of the moment when it was paused."""

    def __init__(self, page: Page, find: str) -> None:
        self._page = page
        self._rows: list[FrameLine] = []
        with ui.element("div").classes("panel"):
            with ui.element("div").classes("row").style("margin-bottom:.5rem"):
                self._paused = ui.switch(page.say("Pause"), on_change=self._pause)
                self._find = ui.input(page.say("Filter"), value=find, placeholder="node 3, BEACON, 103").props(
                    "dense clearable outlined"
                )
                self._find.on_value_change(lambda: self._show(force=True))
            with ui.element("div").classes("ms-split"):
                with ui.element("div").classes("scroll"):
                    self._table = (
                        ui.html("", sanitize=False)
                        .classes("w-full")
                        .on("mousedown", self._clicked, js_handler=_ROW_CLICKED)
                        .on("keydown.enter", self._clicked, js_handler=_ROW_CLICKED)
                    )
                self._detail = ui.html("", sanitize=False).classes("ms-side").props("aria-live=polite")
        page.every_look(self._show)

    def _pause(self) -> None:
        """Keep what the server still has of the past, for filtering at leisure."""
        if self._paused.value:
            self._rows = self._page.service.views.frame_lines(0, KEPT_ROWS)
        self._show(force=True)

    def _show(self, *, force: bool = False) -> None:
        if self._paused.value and self._rows and not force:
            return
        words = str(self._find.value or "").casefold().split()
        if not self._paused.value:
            self._rows = self._page.service.views.frame_lines(0, KEPT_ROWS if words else ROWS)
        rows = [row for row in self._rows if all(word in _text_of(row) for word in words)][-ROWS:]
        head = "".join(
            f"<th>{escape(self._page.say(title))}</th>" for title in ("No.", "Age", "Sender", "Frame", "What it says")
        )
        # Rows that stand still can be reached by the keyboard; others would lose it twice a second.
        is_still = bool(self._paused.value)
        body = "".join(_row_html(row, is_still=is_still) for row in reversed(rows))
        self._table.set_content(
            f'<table class="ms-table stack"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'
        )

    def _clicked(self, event: GenericEventArguments) -> None:
        number = event.args
        # The row may have left the table between the click and now.
        shown = next((row for row in self._rows if row.number == number), None)
        row = shown or self._page.service.views.frame_line(int(number))
        if row is None:
            return
        lines = "".join(
            f"<li{' class=inner' if words.startswith(' ') else ''}>{escape(words.strip())}</li>" for words in row.words
        )
        identifier, _, data = row.text.strip().partition("  ")
        self._detail.set_content(
            f'<div class="panel"><h2>{escape(self._page.say("Frame"))} {row.number}</h2>'
            f'<p class="mono">{escape(self._page.say("identifier"))} <b>{escape(identifier)}</b><br>'
            f"{escape(self._page.say('data'))} <b>{escape(data.strip())}</b></p><ol>{lines}</ol></div>"
        )


_ROW_CLICKED = (
    """(event) => { const row = event.target.closest('tr[data-number]'); if (row) emit(Number(row.dataset.number)); }"""
)


def _text_of(row: FrameLine) -> str:
    return f"node {row.node} {row.sender} {row.text} {' '.join(row.words)}".casefold()


def _row_html(row: FrameLine, *, is_still: bool) -> str:
    hue = row.node * 360 // COLOURS % 360
    mark = f"border-left:5px solid hsl({hue} 60% 50%)" if row.node else "border-left:5px solid transparent"
    first = row.words[0] if row.words else ""
    more = f' <span class="soft">{escape(row.words[1])}</span>' if len(row.words) > 1 else ""
    if len(row.words) > 2 and row.words[-1].startswith(" "):
        more = f' <b class="sample">{escape(row.words[-1].strip())}</b>'
    return (
        f'<tr data-number="{row.number}"{" tabindex=0" if is_still else ""}><td class="num" style="{mark}">{row.number}</td>'
        f'<td class="num">{row.age_s:.2f} s</td><td>{escape(row.sender)}</td><td class="mono">{escape(row.text)}</td>'
        f"<td>{escape(first)}{more}</td></tr>"
    )
