"""The time slider: a person looks at the robot as it was some minutes ago; everybody else's pages stay at the present.

The browser (`static/moment.js`) asks for a moment, another process reads it from the recorder's ring, and the page's
sight becomes that moment until the person comes back. While one moment is read, only the latest wish is remembered.
"""

from __future__ import annotations

import json
import math
import re
import time
from collections.abc import Callable
from datetime import datetime
from typing import TYPE_CHECKING

from nicegui import ui
from nicegui.events import GenericEventArguments

from msbot_web.html import render
from msbot_web.robot_view import PastRobotView
from msbot_web.root_path import root
from msbot_xrce.errors import ConfigError, MsbotError

if TYPE_CHECKING:
    from msbot_web.pages.page import Page
    from msbot_web.recorded_snapshot import RecordedSnapshot

PATHS = ("/", "/bus", "/wires", "/plots")
"""Pages that can show the past."""
PATHS_OF_WORK = ("/", "/wires")
"""Those that can show what a hand-in has, which is without frames."""
SHORTEST_S = 60.0
"""The slider is at least so long, so that a robot that has just begun has one, too."""
LONGEST_S = 3600.0
"""What is older is for `msbot log`."""


class TimeSlider:
    """The slider of one page.

    Args:
        page: whose.
        at: the moment that the page's address asks for, milliseconds since 1970; empty: the present.
        reads: whether the page shows the robot itself, which must be read; curves are read by the page.
        work: the number of a hand-in, whose copy of the recording is shown instead of the recorder's ring; 0: none.
    """

    def __init__(self, page: Page, at: str, *, reads: bool, work: int = 0) -> None:
        self._page = page
        self._reads = reads
        self._work = work
        self._end_s: float | None = None
        self._live = page.sight
        self._wanted: float | None = None
        self._is_reading = False
        self._listeners: list[Callable[[float | None], object]] = []
        self._begin_s: float | None = None
        ui.add_head_html(f'<script src="{root()}/web/moment.js"></script>')
        ui.html(render("look_back", say=page.translate), sanitize=False).classes("w-full ms-moment-place")
        ui.on("ms_moment", self._asked)
        ui.run_javascript(f"msbotMoment.begin({json.dumps(self._setup())})")
        if page.client is not None:
            page.client.on_connect(self._tell_clock)
        page.show_when_ready(self._arrive(_moment_of(at)))

    def on_change(self, listener: Callable[[float | None], object]) -> None:
        """Call the listener whenever another moment is shown; None: the present."""
        self._listeners.append(listener)

    def note(self, at_s: float | None) -> None:
        """The page itself has gone to another moment."""
        self._wanted = self._page.at_s = at_s
        self._tell()

    async def go(self, at_s: float | None) -> None:
        """Show a moment, seconds since 1970, or the present."""
        if at_s is None and self._work:
            with self._page.in_page():
                ui.navigate.to(f"/learn/hand_in/{self._work}")
            return
        self._wanted = at_s
        if at_s is None:
            self._show(None)
        if self._is_reading:
            return  # whoever reads sees the wish when he has done
        self._is_reading = True
        try:
            while (wanted := self._wanted) is not None and wanted != self._page.at_s and not self._page.is_gone:
                await self._read(wanted)
        finally:
            self._is_reading = False

    async def _asked(self, event: GenericEventArguments) -> None:
        at = event.args
        await self.go(at / 1e3 if isinstance(at, int | float) and 0 < at < 1e14 else None)

    async def _arrive(self, at_s: float | None) -> None:
        """What must be read before the slider knows how far back it goes."""
        if self._work:
            await self._arrive_at_work(at_s)
            return
        try:
            self._begin_s = await self._page.service.past.begin_s()
        except ConfigError as error:  # it is not recorded: there is nothing to slide
            if at_s is None:
                ui.run_javascript("msbotMoment.hide()")
            else:
                self._say(str(error))
            return
        if at_s is None:
            self._tell()
        else:
            await self.go(at_s)

    async def _arrive_at_work(self, at_s: float | None) -> None:
        try:
            found = await self._page.service.hand_ins.opened(self._page.session, self._work)
        except MsbotError as error:
            self._say(str(error))
            return
        self._begin_s, self._end_s = found.recorded_from_ns / 1e9, found.recorded_to_ns / 1e9
        await self.go(self._end_s if at_s is None else at_s)

    async def _moment(self, at_s: float) -> RecordedSnapshot:
        service = self._page.service
        if self._work:
            return await service.hand_ins.moment(self._page.session, self._work, at_s)
        return await service.past.snapshot_at(at_s)

    async def _read(self, at_s: float) -> None:
        page = self._page
        if not self._reads:
            self._show(at_s)
            return
        with page.in_page():
            ui.run_javascript("msbotMoment.reading()")
        try:
            moment = await self._moment(at_s)
        except MsbotError as error:
            if self._wanted == at_s:
                self._wanted = page.at_s
                self._say(str(error))
            return
        if self._wanted is not None:
            page.sight = PastRobotView(moment)
            self._show(at_s)

    def _show(self, at_s: float | None) -> None:
        page = self._page
        if page.is_gone:
            return
        if at_s is None:
            page.sight = self._live
        page.at_s = at_s
        for listener in self._listeners:
            listener(at_s)
        page.refresh()
        self._tell()

    def _tell_clock(self) -> None:
        """The browser hears nothing before it is connected: a time that was stamped earlier is late by the loading."""
        ui.run_javascript(f"msbotMoment.clock({time.time() * 1e3})")

    def _tell(self, trouble: str = "") -> None:
        if not self._page.is_gone:
            with self._page.in_page():
                ui.run_javascript(f"msbotMoment.show({json.dumps({**self._setup(), 'trouble': trouble})})")

    def _say(self, words: str) -> None:
        self._tell(self._page.translate(words))

    def _setup(self) -> dict[str, object]:
        """What the browser needs: times are milliseconds since 1970, shown by the clock of the robot's computer."""
        now, at_s, say = time.time(), self._page.at_s, self._page.translate
        begin_s = now - SHORTEST_S if self._begin_s is None else self._begin_s
        if not self._work:
            begin_s = min(max(begin_s, now - LONGEST_S), now - SHORTEST_S)
        zone = datetime.now().astimezone().utcoffset()
        return {
            "now": now * 1e3,
            "begin": begin_s * 1e3,
            "at": None if at_s is None else at_s * 1e3,
            "zone": 0 if zone is None else zone.total_seconds() * 1e3,
            "end": None if self._end_s is None else self._end_s * 1e3,
            "work": self._work,
            "paths": PATHS_OF_WORK if self._work else PATHS,
            "trouble": "",
            "words": {
                "now": say("Now"),
                "past": say("The past: {time}"),
                "ago": say("{span} ago"),
                "reading": say("Reading …"),
            },
        }


def work_of(number: str, path: str) -> int:
    """The number of a hand-in in an address; 0: none, or the page does not show what is handed in."""
    return int(number) if path in PATHS_OF_WORK and re.fullmatch(r"[1-9][0-9]{0,14}", number) else 0


def _moment_of(at: str) -> float | None:
    """A moment in an address; what is none is the present."""
    try:
        found = float(at)
    except ValueError:
        return None
    return found / 1e3 if math.isfinite(found) and 0 < found < 1e14 else None
