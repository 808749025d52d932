"""What all viewers of a page see: worked out and written once, and sent to each browser as one message of changes.

Theory of operation. A page that shows something live names a `LiveView`. Twice a second the channel asks each view that
somebody looks at for its changes, and sends the same text to all browsers that have what was before; a browser that has
not gets the whole once. The browser opens a WebSocket for it (`/live`, `static/live.js`). A tab that is hidden says so:
it gets nothing, and its page is not refreshed. The channel also refreshes what each page shows by NiceGUI, so that a
page needs no timer of its own. A page whose browser has no such WebSocket works as well: it is drawn by NiceGUI alone.

STOP and the parts come first: when the event loop is late, pages are looked after less often (`_Pace`), and are still
told that the robot is there.

The guard has checked host, origin and session. Only the session that opened a page gets what the page shows.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import zlib
from collections.abc import Callable, Hashable, Iterable, Mapping
from itertools import islice
from typing import Final, Protocol

from starlette.routing import WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from msbot_web.access.accounts import Accounts
from msbot_web.access.sessions import Session
from msbot_web.part_websocket import PACKETS, PacketCarrier
from msbot_xrce.errors import MsbotError

LIVE_PATH: Final = "/live"
LOOK_S: Final = 0.5
"""Period in which changes are sent and pages are refreshed."""
QUICK_LOOKS: Final = 5
"""Looks at quick views in that time."""
NUDGED_S: Final = 0.05
"""What somebody did is shown so much later: a STOP reaches its parts first; what comes together is shown together."""
MORE_S: Final = 0.01
"""Pause between two pieces of work on a view that has changed in many places."""
LONGEST_PAUSE_S: Final = 3.0
"""Longest time between two of these looks, however late the event loop is."""
LATE_S: Final = 0.05
"""The event loop is late when it goes on so much later than asked for."""
SHARE: Final = 0.05
"""Pages take at most this part of the time."""
PAGES_IN_TURN: Final = 10
PIECES_IN_TURN: Final = 20
"""Pages that are refreshed, and pieces that are written down, until everything else has its turn. Numbers, not a time:
a process that the system lets wait would do one in each turn."""
ALIVE_S: Final = 0.9
"""A browser hears at least so often that the robot is there, rounded up to a look."""
ALIVE: Final = "."
CHECK_S: Final = 3.0
"""Longest time that a page stays open after its person was signed out elsewhere, or removed."""
SEND_S: Final = 20.0
"""How long a browser may take until there is room for the next message."""
READ_S: Final = 0.05
"""A browser says when it is hidden and seen; whoever says more is read so slowly."""
LEAST_PACKED: Final = 1000
"""Characters from which on a message is packed (zlib), once for all browsers, for those that can unpack it."""
NOT_THERE: Final = 4404
NONSENSE: Final = 4400
REPLACED: Final = 4409
OVER: Final = 4401

_log = logging.getLogger(__name__)
_PAGES = logging.getLogger("nicegui")
"""Where mistakes of pages are said, and said once (`page_errors.py`)."""


class LivePage(Protocol):
    """An open page, as the channel sees it."""

    session: Session

    @property
    def is_connected(self) -> bool:
        """Whether the browser hears what it is told by NiceGUI."""

    def refresh(self) -> None:
        """Show what is so now."""

    def check_session(self) -> None:
        """Leave the page when its session has ended."""


class News:
    """What is sent to many browsers: written once, and packed once."""

    def __init__(self, text: str) -> None:
        self.text = text
        self._packed: bytes | None = None

    def packed(self) -> str | bytes:
        """The shorter of the two forms."""
        if len(self.text) < LEAST_PACKED:
            return self.text
        if self._packed is None:
            self._packed = zlib.compress(self.text.encode(), 1)
        return self._packed


_ALIVE = News(ALIVE)


class LiveView:
    """Something that many look at: named pieces, each with a mark that changes whenever the piece does.

    Args:
        name: what the browser's script calls it.
        marks: the mark of each piece that there is.
        piece: a piece as the browser's script takes it, as plain JSON.
        is_quick: it moves, and is looked at more often.
    """

    def __init__(
        self,
        name: str,
        marks: Callable[[], Mapping[str, Hashable]],
        piece: Callable[[str], object],
        *,
        is_quick: bool = False,
    ) -> None:
        self.name = name
        self.is_quick = is_quick
        self.number = 0
        """Counts the changes."""
        self.changes = News("")
        """The last of them."""
        self._marks = marks
        self._piece = piece
        self._shown: dict[str, Hashable] = {}
        self._pieces: dict[str, str] = {}
        self._left: dict[str, Hashable] = {}
        """Pieces that have changed, for which there was no time yet, with their marks."""
        self._written: list[str] = []
        """Those that are written down, and not sent."""
        self._whole: News | None = None

    def look(self) -> bool:
        """Find out what has changed; True: not all of it is written down yet, the next call goes on."""
        if not self._left:
            marks = self._marks()
            shown = self._shown
            self._left = {name: mark for name, mark in marks.items() if name not in shown or shown[name] != mark}
            gone = [name for name in shown if name not in marks]
            for name in gone:
                del shown[name], self._pieces[name]
            self._written = [name for name in self._written if name in shown]  # should the last look have failed
            if not self._left and not gone and not self._written:
                return False
        for name in list(islice(self._left, PIECES_IN_TURN)):
            mark = self._left.pop(name)
            self._pieces[name] = json.dumps(self._piece(name))
            self._shown[name] = mark
            self._written.append(name)
        if self._left:
            return True
        self.number += 1
        self.changes, self._written, self._whole = self._text(self._written), [], None
        return False

    def whole(self) -> News:
        """All pieces."""
        if self._whole is None:
            self._whole = self._text(self._pieces)
        return self._whole

    def _text(self, names: Iterable[str]) -> News:
        inner = ",".join(f"{json.dumps(name)}:{self._pieces[name]}" for name in names)
        return News(f"{{{json.dumps(self.name)}:{{{inner}}}}}")


class _Line:
    """A browser's WebSocket: one message at a time, so that nothing piles up before a browser that reads slowly."""

    def __init__(self, socket: WebSocket, *, unpacks: bool) -> None:
        self._unpacks = unpacks
        self.busy_since: float | None = None
        self.task: asyncio.Task[None] | None = None
        self.code = 1000
        """Why it is closed by us."""
        self._socket = socket
        self._carrier: PacketCarrier | None = socket.scope["state"].get(PACKETS)
        self._news: str | bytes = ""
        self._is_due = asyncio.Event()

    def send(self, news: News, now: float) -> None:
        """Send something; only while it is not busy."""
        self._news = news.packed() if self._unpacks else news.text
        if self._carrier is not None and self._carrier.send_packet(self._news):
            return
        self.busy_since = now
        self._is_due.set()

    async def write(self) -> None:
        """Send what is to be sent, until the connection ends."""
        while True:
            await self._is_due.wait()
            self._is_due.clear()
            if isinstance(self._news, str):
                await self._socket.send_text(self._news)
            else:
                await self._socket.send_bytes(self._news)
            self.busy_since = None

    def end(self, code: int) -> None:
        """Close it."""
        if self.task is not None:
            self.code = code
            self.task.cancel()


class _Pace:
    """How long pages wait for the next look."""

    def __init__(self) -> None:
        self.pause_s = LOOK_S

    def note(self, late_s: float, busy_s: float) -> None:
        """Note a look: how late it began, and how long it worked, without what others did meanwhile."""
        if late_s > LATE_S:
            self.pause_s = min(2 * self.pause_s, LONGEST_PAUSE_S)
        else:
            self.pause_s = max(self.pause_s / 2, LOOK_S)
        self.pause_s = min(max(self.pause_s, busy_s / SHARE), LONGEST_PAUSE_S)


class _Viewer:
    """An open page and what its browser has."""

    def __init__(self, page: LivePage) -> None:
        self.page = page
        self.view: LiveView | None = None
        self.line: _Line | None = None
        self.is_hidden = False
        self.seen: int | None = None
        """Up to which change of its view the browser has everything; None: it has nothing."""
        self.heard_at = 0.0
        """When it was last sent something."""
        self.checked_at = 0.0


class LiveChannel:
    """See the module's docstring.

    Args:
        accounts: who is signed in.
    """

    def __init__(self, accounts: Accounts) -> None:
        self._accounts = accounts
        self._viewers: dict[str, _Viewer] = {}
        """By the number of the page."""
        self._views: dict[Hashable, LiveView] = {}
        self._is_nudged = False
        self._has_viewers = asyncio.Event()
        self._busy_s = 0.0
        """How long it has worked since all pages were looked after."""
        self.looks = 0
        """Counts the times that all pages were looked after."""
        self.is_looking = False
        """It looks after them now: what one page asked for is good enough for the others."""
        accounts.sessions.on_end(self._ended)

    def route(self) -> WebSocketRoute:
        """The place in the server."""
        return WebSocketRoute(LIVE_PATH, self.serve)

    # For pages

    def add(self, number: str, page: LivePage) -> None:
        """Look after an open page from now on; `number` is NiceGUI's."""
        self._viewers[number] = _Viewer(page)
        self._has_viewers.set()

    def remove(self, number: str) -> None:
        """The page was closed."""
        viewer = self._viewers.pop(number, None)
        if not self._viewers:
            self._has_viewers.clear()
        if viewer is not None:
            self._show(viewer, None)
            if viewer.line is not None:
                viewer.line.end(NOT_THERE)

    def show(self, number: str, key: Hashable, make: Callable[[], LiveView]) -> bool:
        """Have a page show a view, made if nobody looks at it yet; False: the page has to be drawn by NiceGUI.

        Args:
            number: the page's.
            key: equal for all who see the same.
            make: makes the view.
        """
        viewer = self._viewers.get(number)
        if viewer is None or viewer.line is None:
            return False
        view = self._views.get(key)
        if view is None:
            view = self._views[key] = make()
            if view.look():
                self._look_in(0.0)
        if viewer.view is not view:
            self._show(viewer, view)
        return True

    def hide(self, number: str) -> None:
        """The page shows no view for now."""
        viewer = self._viewers.get(number)
        if viewer is not None:
            self._show(viewer, None)

    def again(self, number: str) -> None:
        """Send a page the whole of its view once more: what it is shown in was made anew."""
        viewer = self._viewers.get(number)
        if viewer is not None:
            viewer.seen = None

    def nudge(self) -> None:
        """Something was done: send what has changed soon, not only with the next look."""
        if self._views:
            self._look_in(NUDGED_S)

    def _look_in(self, seconds: float) -> None:
        if not self._is_nudged:
            self._is_nudged = True
            asyncio.get_running_loop().call_later(seconds, self._look)

    def _show(self, viewer: _Viewer, view: LiveView | None) -> None:
        viewer.view, viewer.seen = view, None
        used = {id(one.view) for one in self._viewers.values()}
        for key in [key for key, one in self._views.items() if id(one) not in used]:
            del self._views[key]

    # Sending

    async def run(self) -> None:
        """Send and refresh until cancelled; nothing is done while no page is open."""
        time, pace = asyncio.get_running_loop().time, _Pace()
        due = time() + LOOK_S
        while True:
            if not self._viewers:
                await self._has_viewers.wait()
                due = time() + LOOK_S
            await self._wait_until(due, may_be_quick=pace.pause_s <= LOOK_S)
            late_s = time() - due
            await self._look_after_pages()
            pace.note(late_s, self._busy_s)
            self._busy_s = 0.0
            due = max(due + pace.pause_s, time())

    async def _wait_until(self, due: float, *, may_be_quick: bool) -> None:
        """Wait, and send meanwhile what is quick, and that the robot is there."""
        time = asyncio.get_running_loop().time
        while (left_s := due - time()) > 0.0:
            is_quick = may_be_quick and any(view.is_quick for view in self._views.values())
            step_s = LOOK_S / QUICK_LOOKS if is_quick else LOOK_S
            await asyncio.sleep(min(left_s, step_s))
            if due - time() > step_s / 2:
                self._look(only_quick=True)

    async def _look_after_pages(self) -> None:
        """Refresh all pages and send what has changed."""
        time = asyncio.get_running_loop().time
        began = time()
        self.looks += 1
        self.is_looking = True
        try:
            refreshed = 0
            for number in list(self._viewers):
                refreshed += self._refresh(number)
                if refreshed == PAGES_IN_TURN:
                    self._busy_s += time() - began
                    await asyncio.sleep(0)  # STOP, and parts, wait for a few pages, not for thirty
                    refreshed, began = 0, time()
            self._busy_s += time() - began
            self._look()
        finally:
            self.is_looking = False

    def _refresh(self, number: str) -> bool:
        viewer = self._viewers.get(number)
        if viewer is None or viewer.is_hidden or not viewer.page.is_connected:
            return False
        now = asyncio.get_running_loop().time()
        try:
            viewer.page.refresh()
            if now - viewer.checked_at >= CHECK_S:
                viewer.checked_at = now
                viewer.page.check_session()
        except Exception:  # one page's mistake is not the others'
            _PAGES.exception("a page could not be refreshed")
        return True

    def _look(self, *, only_quick: bool = False) -> None:
        """Send what has changed to all who look."""
        self._is_nudged = False
        time = asyncio.get_running_loop().time
        now, is_more = time(), False
        wanted = {id(one.view) for one in self._viewers.values() if one.line is not None and not one.is_hidden}
        for view in self._views.values():
            if id(view) in wanted and (view.is_quick or not only_quick):
                try:
                    is_more = view.look() or is_more
                except MsbotError as error:
                    _log.warning("what pages show of %s stays as it was: %s", view.name, error)
                except Exception:  # what others look at goes on
                    _PAGES.exception("what pages show of %s stays as it was", view.name)
        for viewer in self._viewers.values():
            self._tell(viewer, now, only_quick=only_quick)
        self._busy_s += time() - now
        if is_more:
            self._look_in(MORE_S)

    def _tell(self, viewer: _Viewer, now: float, *, only_quick: bool) -> None:
        line, view = viewer.line, viewer.view
        if line is None or viewer.is_hidden:
            return
        if line.busy_since is not None:
            if now - line.busy_since > SEND_S:
                line.end(1008)
            return
        if not self._accounts.holds(viewer.page.session):
            line.end(OVER)
            return
        news: News | None = None
        if view is not None and viewer.seen != view.number > 0 and (view.is_quick or not only_quick):
            news = view.changes if viewer.seen == view.number - 1 else view.whole()
            viewer.seen = view.number
        elif now - viewer.heard_at >= ALIVE_S:
            news = _ALIVE
        if news is not None:
            viewer.heard_at = now
            line.send(news, now)

    # Browsers

    async def serve(self, socket: WebSocket) -> None:
        """One browser's connection, from its first octet to its last."""
        session = socket.scope["state"]["session"]
        viewer = self._viewers.get(socket.query_params.get("page", ""))
        await socket.accept()
        if viewer is None or viewer.page.session is not session:
            await socket.close(NOT_THERE)
            return
        if viewer.line is not None:
            viewer.line.end(REPLACED)
        line = viewer.line = _Line(socket, unpacks=socket.query_params.get("packed") == "1")
        viewer.seen, viewer.is_hidden, viewer.heard_at = None, False, 0.0
        writing = asyncio.ensure_future(line.write())
        line.task = asyncio.ensure_future(self._read(socket, viewer))
        try:
            await asyncio.wait((writing, line.task), return_when=asyncio.FIRST_COMPLETED)
        finally:
            if viewer.line is line:
                viewer.line, viewer.is_hidden = None, False
                self._show(viewer, None)
            for task in (writing, line.task):
                task.cancel()
            await asyncio.gather(writing, line.task, return_exceptions=True)
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):  # it went by itself
            await socket.close(line.code)

    async def _read(self, socket: WebSocket, viewer: _Viewer) -> None:
        while True:
            message = await socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            words = message.get("text")
            if words not in ("hidden", "shown"):
                if viewer.line is not None:
                    viewer.line.code = NONSENSE
                return
            viewer.is_hidden = words == "hidden"
            if words == "shown":
                viewer.heard_at = 0.0
                viewer.page.refresh()
                self._look()
            await asyncio.sleep(READ_S)

    def _ended(self, session: Session) -> None:
        for viewer in self._viewers.values():
            if viewer.page.session is session and viewer.line is not None:
                viewer.line.end(OVER)
