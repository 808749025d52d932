"""The page Arena: the world that simulated robots drive in, live; drag a robot, pause, drive by hand.

Where everything is goes to the browsers ten times a second; `static/arena.js` draws the frames in between.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import partial

from fastapi import Request
from nicegui import ui
from nicegui.events import GenericEventArguments

from msbot.operations.rights import Right
from msbot_web.access.sessions import Session
from msbot_web.arena_view import UNITS
from msbot_web.html import render
from msbot_web.live_channel import LiveView
from msbot_web.models.robot_models import ChangeResult
from msbot_web.page_errors import read_from_browser
from msbot_web.pages.gallery import back_to_rover
from msbot_web.pages.layout import page_frame
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import heading, panel, set_html
from msbot_web.pages.pilot import pilot_slot, take_out
from msbot_web.root_path import root
from msbot_web.service import Service

PUSH_S = 0.1
WATCH_S = 0.25
"""Period in which who drives by hand is looked after, where the picture comes by itself."""
SPEEDS = {"¼": 0.25, "½": 0.5, "1": 1.0, "2": 2.0, "4": 4.0}
HELD_S = 0.8
"""Who drives by hand says so several times a second; after this long the robot is told to stand."""
TOLD_S = 5.0
"""What robots do is read out at most so often: who listens must be able to do something else, too."""
POWER = 55.0
BUTTONS = (
    ("up", "arrow_upward", "Ahead", (1, 1, 1, 1)),
    ("left", "rotate_left", "Turn left", (-0.5, 0.5, -0.5, 0.5)),
    ("right", "rotate_right", "Turn right", (0.5, -0.5, 0.5, -0.5)),
    ("down", "arrow_downward", "Back", (-1, -1, -1, -1)),
    ("slide-left", "west", "To the left", (-1, 1, 1, -1)),
    ("slide-right", "east", "To the right", (1, -1, -1, 1)),
)
"""Where a button is, what it shows and says, and the powers it gives: left, right, rear left, rear right."""
POWERS = ("left_power", "right_power", "rear_left_power", "rear_right_power")


def register(service: Service) -> None:
    """Make the page known."""

    @ui.page("/arena")
    def arena(request: Request) -> None:
        with page_frame(service, request, "/arena", "Arena") as page:
            if not service.arena.is_there:
                with panel():
                    ui.label(page.translate("This robot is in no world that is here."))
                    ui.link(page.translate("Robots and worlds"), "/gallery")
                    ui.label(
                        page.translate("A robot that has joined another program's world is shown on that one's page.")
                    )
                return
            back_to_rover(page)
            ui.add_head_html(f'<script src="{root()}/web/arena.js"></script>')
            _ArenaPage(page)


class _ArenaPage:
    """See the module's docstring."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._arena = page.service.arena
        self._pilot = pilot_slot(page.service)
        self._driven_at: float | None = None
        self._is_seen = True
        self._told_at: float | None = None
        self._make()
        setup = {
            "host": self._host.html_id,
            "state": self._arena.state(),
            "may": page.may(Right.OPERATE),
            "words": {"drag": page.translate("drag it, or move it with the arrow keys; Shift turns it")},
        }
        ui.run_javascript(f"msbotArena.begin({json.dumps(setup)})")
        for event, handler in (("arena_put", self._put), ("arena_drive", self._drive), ("arena_seen", self._seen)):
            ui.on(event, handler)
        ui.run_javascript("msbotLive.show('arena', (news) => msbotArena.show(news.state))")
        self._timer = ui.timer(PUSH_S, self._push)
        if page.client is not None:
            page.client.on_disconnect(self._stands)
            page.client.on_delete(self._closed)
        page.every_look(self._show)

    def _make(self) -> None:
        say, may = self._page.translate, self._page.may(Right.OPERATE)
        with panel():
            with ui.element("div").classes("row spread"):
                heading(say(self._arena.name))
                with ui.element("div").classes("row"):
                    self._button("zoom_in", say("Zoom in"), "msbotArena.zoom(.7)")
                    self._button("zoom_out", say("Zoom out"), "msbotArena.zoom(1.4)")
                    self._button("fit_screen", say("All of it"), "msbotArena.fit()")
                    self._button("gesture", say("Trail"), "msbotArena.toggle('trails', this)", pressed=True)
                    self._button("sensors", say("Rays"), "msbotArena.toggle('rays', this)", pressed=True)
            with ui.element("div").classes("arena-area"):
                self._host = ui.html(self._arena.picture(), sanitize=False).classes("w-full")
            with ui.element("div").classes("row").style("margin-top:.6rem"):
                self._pause = ui.button(say("Pause"), icon="pause", on_click=self._pause_it).props("flat")
                step = ui.button(say("One step"), icon="skip_next", on_click=self._step_it).props("flat")
                reset = ui.button(say("Begin anew"), icon="restart_alt", on_click=self._reset_it).props("flat")
                now = next(word for word, speed in SPEEDS.items() if speed == self._arena.speed)
                speed = ui.label(say("Speed")).classes("soft")
                self._speed = ui.toggle([*SPEEDS], value=now, on_change=self._speed_chosen).props(
                    f'no-caps dense aria-label="{say("Speed")}"'
                )
                for element in (self._pause, step, reset, speed, self._speed):
                    element.set_visibility(may)
                self._clock = ui.label("").classes("soft")
        if self._pilot and may:
            self._make_drive()
        with panel():
            heading(say("What the robots do and sense"))
            self._words = ui.html("", sanitize=False).classes("w-full")
            self._voice = ui.label("").classes("sr").props("role=status id=ms-arena-told")
            self._table = ui.html("", sanitize=False).classes("w-full scroll").props("tabindex=0 id=ms-arena-senses")

    def _make_drive(self) -> None:
        say = self._page.translate
        with panel():
            heading(say("Drive by hand"))
            self._plug = ui.button(say("Plug the pilot in"), icon="power", on_click=self._plug_pilot)
            self._unplug = ui.button(say("Take the pilot out"), icon="power_off").props("outline")
            self._unplug.on_click(partial(take_out, self._page, self._pilot))
            with ui.element("div").classes("arena-pad") as self._pad:
                for area, icon, words, powers in BUTTONS:
                    if area in ("slide-left", "slide-right") and not self._arena.can_slide:
                        continue
                    driven = ",".join(f"{POWER * power:g}" for power in powers)
                    button = ui.button(icon=icon).props(f'round aria-label="{say(words)}" data-drive="{driven}"')
                    button.style(f"grid-area:{area}")
            words = say("Hold a button, an arrow key, or W, A, S, D. The pilot goes when this page is closed.")
            self._hint = ui.label(words).classes("soft")

    def _button(self, icon: str, words: str, script: str, *, pressed: bool | None = None) -> None:
        button = ui.button(icon=icon).props("flat round dense")
        button.on("click", js_handler=f"(event) => {script.replace('this', 'event.currentTarget')}")
        button.props["aria-label"] = button.props["title"] = words
        if pressed is not None:
            button.props["aria-pressed"] = "true"

    # What is shown.

    def _push(self) -> None:
        is_live = self._page.service.live.show(self._page.client_id, "arena", self._live_view)
        self._timer.interval = WATCH_S if is_live else PUSH_S
        if not is_live and self._is_seen and self._page.is_connected:
            ui.run_javascript(f"msbotArena.show({json.dumps(self._arena.state())})")
        if self._driven_at is not None and self._page.service.now() - self._driven_at > HELD_S:
            self._stands()
            self._page.let_go()

    def _live_view(self) -> LiveView:
        """Where everything is, the same for all who look."""
        found: dict[str, object] = {}

        def marks() -> dict[str, str]:
            found["state"] = state = self._arena.state()
            return {"state": json.dumps(state)}

        return LiveView("arena", marks, found.__getitem__, is_quick=True)

    def _show(self) -> None:
        page = self._page
        self._pause.set_text(page.translate("Go on") if self._arena.paused else page.translate("Pause"))
        self._pause.props(f"icon={'play_arrow' if self._arena.paused else 'pause'}")
        self._clock.set_text(page.translate("{seconds:.0f} s in the world", seconds=self._arena.state()["t"]))
        set_html(self._words, render("lines", say=page.translate, lines=self._arena.describe()))
        self._tell()
        rows = [
            [
                part.robot,
                part.slot,
                ", ".join(f"{name} {self._value(name, value)}" for name, value in part.values.items()),
            ]
            for part in self._arena.sensed()
        ]
        heads = [page.translate(word) for word in ("Robot", "Slot", "Senses")]
        set_html(self._table, render("table", heads=heads, rows=rows))
        if self._pilot and page.may(Right.OPERATE):
            plugged = page.service.views.bench.is_plugged(self._pilot)
            self._plug.set_visibility(not plugged)
            self._unplug.set_visibility(plugged)
            self._pad.set_visibility(plugged)
            self._hint.set_visibility(plugged)

    def _tell(self) -> None:
        """Have a screen reader say where the robots are: when that has changed, and not again and again."""
        now = self._page.service.now()
        words = " ".join(f"{self._page.translate(one)}." for one in self._arena.spoken_summary())
        if words != self._voice.text and (self._told_at is None or now - self._told_at >= TOLD_S):
            self._told_at = now
            self._voice.set_text(words)

    def _value(self, name: str, value: float | bool) -> str:
        if isinstance(value, bool):
            return self._page.translate("yes") if value else self._page.translate("no")
        if name == "heading":
            value = round(value) % 360
        unit = UNITS.get(name.partition(".")[0], "")
        number = self._page.number(round(value, 4) + 0.0, ".3g")  # 0 and not -5.55e-17
        return f"{number}{'' if unit.startswith('°') else ' '}{unit}".rstrip()

    # What a person does.

    async def _pause_it(self) -> None:
        await self._page.act("pause_world", off=self._arena.paused, quiet=True)

    async def _step_it(self) -> None:
        await self._page.act("step_world", quiet=True)

    async def _reset_it(self) -> None:
        if await self._page.act("reset_world") is not None:
            ui.run_javascript("msbotArena.forget()")

    async def _speed_chosen(self) -> None:
        await self._page.act("world_speed", speed=SPEEDS[str(self._speed.value)], quiet=True)

    async def _put(self, event: GenericEventArguments) -> None:
        with read_from_browser():
            name, *place = event.args
            x, y, heading_deg = (None if number is None else float(number) for number in place)
        turned = {} if heading_deg is None else {"heading": heading_deg}
        await self._page.act("put_robot", robot=str(name), x=x, y=y, **turned, quiet=True)

    def _seen(self, event: GenericEventArguments) -> None:
        """The page is looked at again, or no more."""
        self._is_seen = bool(event.args)

    async def _plug_pilot(self) -> None:
        page = self._page
        if await page.do(lambda session: page.service.plug(session, self._pilot, plugged=True), quiet=True) is not None:
            self._arena.drivers.add(page.client)

    def _closed(self) -> None:
        """The pilot goes with the last page that drives by it."""
        drivers = self._arena.drivers
        if self._page.client in drivers:
            drivers.discard(self._page.client)
            if not drivers and self._page.service.views.bench.is_plugged(self._pilot):
                self._page.service.end_pilot(self._pilot)

    async def _drive(self, event: GenericEventArguments) -> None:
        with read_from_browser():
            powers = [max(-100.0, min(100.0, float(power))) for power in event.args[: len(POWERS)]]
        if self._pilot and self._page.service.views.bench.is_plugged(self._pilot):
            self._driven_at = self._page.service.now() if any(powers) else None
            done = await self._page.do(lambda session: self._power(session, powers), quiet=True)
            if done is not None and self._arena.drivers:  # else it was plugged in elsewhere, and stays
                self._arena.drivers.add(self._page.client)

    def _power(self, session: Session, powers: Sequence[float]) -> ChangeResult:
        done = [
            self._page.operate(self._pilot, control, power, session)
            for control, power in zip(POWERS, powers, strict=False)
        ]
        return done[-1] if done else ChangeResult(words="")

    def _stands(self) -> None:
        """Nobody holds a button any more: the page or its connection is gone, or says nothing."""
        self._driven_at = None
