"""One opened page: for whom, in which language, what it shows periodically, and how its actions are done."""

from __future__ import annotations

import asyncio
import inspect
import logging
from collections.abc import Awaitable, Callable, Coroutine
from contextlib import AbstractContextManager, nullcontext
from dataclasses import field
from datetime import datetime
from typing import Any, Protocol

from nicegui import Client, ui

from msbot.operations.rights import Right
from msbot_agent.text.sentence import said
from msbot_school.lessons.catalog import SIMPLE
from msbot_web.access.accounts import SignedOut
from msbot_web.access.sessions import Session
from msbot_web.api.dependencies import octets_for, words_for
from msbot_web.api.uid_redactor import UidRedactor
from msbot_web.language import Language
from msbot_web.models.bus_models import FrameLine
from msbot_web.models.robot_models import ChangeResult, Scalar
from msbot_web.robot_view import LiveRobotView, RobotView
from msbot_web.service import Service, done_of
from msbot_xrce.errors import ConfigError, MsbotError, NotThere
from msbot_xrce.lazy import dataclass

_log = logging.getLogger(__name__)


Refresh = Callable[[], object]
"""Shows the present state; waits only if it gives a coroutine."""


class Moments(Protocol):
    """Chooses the moment that a page shows: its time slider."""

    def on_change(self, listener: Callable[[float | None], object]) -> None:
        """Call the listener whenever another moment is shown, seconds since 1970; None: the present."""

    def note(self, at_s: float | None) -> None:
        """Note that the page itself has gone to another moment."""


@dataclass(slots=True)
class Page:
    """One opened page: for whom, in which language, and how its actions are done."""

    service: Service
    session: Session
    language: Language
    easy: bool = False
    """Whether the person wants it easy to read."""
    refreshers: list[tuple[Refresh, ui.element | None]] = field(default_factory=list)
    reading: set[Refresh] = field(default_factory=set)
    """Refreshers that wait for what they show."""
    trouble: str = ""
    """What could not be shown lately."""
    client: Client | None = None
    """The browser's page, for what is shown after waiting."""
    tasks: set[asyncio.Task[None]] = field(default_factory=set)
    """What waits."""
    at_s: float | None = None
    """Which moment it shows, seconds since 1970; None: the present."""
    time_slider: Moments | None = None
    """Its time slider; None: it shows the present only."""
    sight: RobotView = field(init=False)
    """What it looks at."""

    def __post_init__(self) -> None:
        self.sight = LiveRobotView(self.service)

    @property
    def client_id(self) -> str:
        """NiceGUI's number of it."""
        return "" if self.client is None else self.client.id

    @property
    def reads(self) -> str:
        """In which language, and how, the person reads lessons, as in RFC 5646: `de`, or `de-simple`."""
        return self.language.code + (SIMPLE if self.easy else "")

    @property
    def is_past(self) -> bool:
        """Whether it shows the past: then nothing can be done to the robot but STOP."""
        return self.at_s is not None

    def translate(self, text: str, **values: object) -> str:
        """A text in the person's language; students read no addresses of parts in it."""
        return self.language.translate(words_for(self.session, text), **values)

    def private_octets(self) -> UidRedactor:
        """What the person does not see of frames."""
        return octets_for(self.session, self.service, self.sight.robot())

    def frame_lines(self, limit: int) -> list[FrameLine]:
        """The newest frames, oldest first, as the person may see them."""
        return self.private_octets().frames(self.sight.frame_lines(0, limit))

    def number(self, value: float, form: str = "") -> str:
        """A number as the person's language writes it; `form` as in `format`."""
        return self.language.number(value, form)

    def when(self, at_ms: int) -> str:
        """A moment, milliseconds since 1970, on the clock of the robot's computer."""
        return datetime.fromtimestamp(at_ms / 1000).strftime("%Y-%m-%d %H:%M:%S")

    def may(self, right: Right) -> bool:
        """Whether to offer something at all; whether it may be done is checked again when it is done."""
        return self.session.may(right)

    def may_at(self, right: Right, slot: str) -> bool:
        """Whether to offer something at a slot: nothing at one of another group."""
        if not self.may(right) or self.may(Right.ARRANGE):
            return self.may(right)
        control = self.service.operations.pupils
        owner = next((group.name for group in control.groups if slot in group.slots), "")
        return owner in ("", control.group_of(self.session.name))

    async def act(self, operation: str, *, quiet: bool = False, **arguments: Any) -> ChangeResult | None:  # noqa: ANN401 - as the table has them
        """Have an operation of the table done for the person, and say what came of it; None when it was refused."""

        async def deed(session: Session) -> ChangeResult:
            who = self.service.asker(session)
            return done_of(await self.service.operations.do(operation, who=who, **arguments))

        return await self.do(deed, quiet=quiet)

    async def do(
        self, deed: Callable[[Session], ChangeResult | Awaitable[ChangeResult]], *, quiet: bool = False
    ) -> ChangeResult | None:
        """Do something for the person and say what came of it; None when it was refused."""
        try:
            self._check_present()
            result = deed(self.session)
            done = await result if inspect.isawaitable(result) else result
        except MsbotError as error:
            self._refused(error)
            return None
        return self._done(done, quiet=quiet)

    def do_now(self, deed: Callable[[Session], ChangeResult], *, quiet: bool = False) -> ChangeResult | None:
        """Do something that waits for nothing, before any refresh could show what was so before it."""
        try:
            self._check_present()
            done = deed(self.session)
        except MsbotError as error:
            self._refused(error)
            return None
        return self._done(done, quiet=quiet)

    def _check_present(self) -> None:
        if self.is_past:
            raise ConfigError(said("this page shows the past: go back to now before you change the robot"))

    def _refused(self, error: MsbotError) -> None:
        if self.is_gone:
            return
        if isinstance(error, SignedOut):
            ui.run_javascript("msbotSignIn()")
        else:
            ui.notify(
                self.translate(str(error)),
                type="negative",
                multi_line=True,
                close_button=self.translate("Close"),
                timeout=10_000,
            )

    def _done(self, done: ChangeResult, *, quiet: bool) -> ChangeResult:
        if self.is_gone:
            return done
        with self.in_page():
            if not quiet:
                ui.notify(self.translate(done.words), type="positive", multi_line=True)
        self.refresh()
        self.service.live.nudge()
        return done

    def every_look(self, refresh: Refresh, owner: ui.element | None = None) -> None:
        """Call something now, twice a second, and at once after each action, as long as page and owner are there."""
        self._call(refresh)
        self.refreshers.append((refresh, owner))

    def show_when_ready(self, work: Coroutine[object, object, None]) -> None:
        """Show something as soon as what it shows has been read."""

        async def in_page() -> None:
            with self.in_page():
                await work

        task = asyncio.get_running_loop().create_task(in_page())
        self.tasks.add(task)
        task.add_done_callback(self.tasks.discard)

    def every(self, seconds: float, act: Callable[[], object]) -> None:
        """Do something periodically while the page is connected: what is said meanwhile would pile up."""

        def look() -> object:
            return act() if self.is_connected else None

        ui.timer(seconds, look)

    def _call(self, refresh: Refresh) -> None:
        if refresh in self.reading:
            return
        waiting = refresh()
        if not inspect.isawaitable(waiting):
            return
        self.reading.add(refresh)

        async def finish() -> None:
            try:
                await waiting
            except MsbotError as error:
                self._say_once(str(error))
            finally:
                self.reading.discard(refresh)

        self.show_when_ready(finish())

    @property
    def is_gone(self) -> bool:
        """Whether the browser's page was closed: nothing can be shown on it any more."""
        return self.client is not None and self.client.is_deleted

    @property
    def is_connected(self) -> bool:
        """Whether the browser hears at once what it is told."""
        return self.client is None or self.client.has_socket_connection

    def operate(self, slot: str, control: str, value: Scalar, session: Session) -> ChangeResult:
        """Do something to a simulated part: what is held is let go when this page is closed or its connection lost."""
        done = self.service.operate(session, slot, control, value, on_page=self.client)
        if not self.is_connected:  # it went while this waited for its turn
            self.let_go()
        return done

    def let_go(self) -> None:
        """Let go of what is held with this page."""
        self.service.let_go(self.client)

    def closed(self) -> None:
        """Show nothing any more: the browser's page was closed, maybe while something was being read for it."""
        self.let_go()
        self.service.live.remove(self.client_id)
        self.refreshers.clear()
        for task in self.tasks:
            task.cancel()

    def in_page(self) -> AbstractContextManager[object]:
        """Show what follows in the page itself, because the element that was clicked may be gone by now."""
        return self.client or nullcontext()

    def refresh(self) -> None:
        """Look again now."""
        with self.in_page():
            self._refresh()

    def _refresh(self) -> None:
        self.refreshers = [
            (refresh, owner) for refresh, owner in self.refreshers if owner is None or not owner.is_deleted
        ]
        for refresher in tuple(self.refreshers):
            refresh, owner = refresher
            if owner is not None and owner.is_deleted:
                continue  # by a refresher before it
            try:
                self._call(refresh)
            except NotThere:
                self.refreshers = [one for one in self.refreshers if one is not refresher]
            except MsbotError as error:
                self._say_once(str(error))

    def check_session(self) -> None:
        """Leave the page when its session has ended."""
        if not self.service.accounts.holds(self.session):
            self.refreshers.clear()
            with self.in_page():
                ui.run_javascript("msbotSignIn()")

    def _say_once(self, words: str) -> None:
        """Log once that something cannot be shown; the next refresh tries again."""
        if words != self.trouble:
            self.trouble = words
            _log.warning("the page of %s shows what it showed before: %s", self.session.name, words)
