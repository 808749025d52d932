"""What every page has around it: the robot's name, the way to the other pages, STOP, and who is signed in."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from html import escape

from fastapi import Request
from nicegui import ui
from nicegui.events import KeyEventArguments, UploadEventArguments

from msbot.errors import MsbotError
from msbot.web.accounts import Session, SignedOut
from msbot.web.guard import CSRF_HEADER
from msbot.web.language import COOKIE as LANGUAGE_COOKIE
from msbot.web.language import Language, language_of, languages
from msbot.web.models import Done
from msbot.web.roles import Right
from msbot.web.service import Service
from msbot.web.views import NotThere

_log = logging.getLogger(__name__)

LOOK_S = 0.5
"""Pages look at the robot that often."""
CHECK_S = 3.0
"""So long at most a page stays open whose person was signed out elsewhere, or removed."""
TWICE_S = 0.8
"""Two presses of Escape within this time are STOP."""


@dataclass(frozen=True, slots=True)
class Way:
    """One entry of the menu."""

    path: str
    icon: str
    title: str
    right: Right = Right.SEE


MENU = (
    Way("/", "smart_toy", "Robot"),
    Way("/arrivals", "move_to_inbox", "Arrivals"),
    Way("/settings", "tune", "Settings"),
    Way("/bus", "cable", "Bus"),
    Way("/wires", "hub", "Wires"),
    Way("/timeline", "timeline", "Timeline"),
    Way("/library", "menu_book", "Library"),
    Way("/journal", "history", "Journal"),
    Way("/class", "grid_view", "Class"),
    Way("/admin", "manage_accounts", "Admin", Right.ADMINISTER),
)


@dataclass(slots=True)
class Page:
    """One opened page: for whom, in which language, and how its deeds are done."""

    service: Service
    session: Session
    language: Language
    refreshers: list[tuple[Callable[[], None], ui.element | None]] = field(default_factory=list)
    trouble: str = ""
    """What could not be shown lately."""

    def say(self, text: str, **values: object) -> str:
        """A text in the person's language."""
        return self.language.say(text, **values)

    def may(self, right: Right) -> bool:
        """Whether to offer something at all; whether it may be done is checked again when it is done."""
        return self.session.may(right)

    def do(self, deed: Callable[[Session], Done], *, quiet: bool = False) -> Done | None:
        """Do something for the person and say what came of it; None when it was refused."""
        try:
            done = deed(self.session)
        except SignedOut:
            ui.run_javascript("msbotSignIn()")
            return None
        except MsbotError as error:
            ui.notify(str(error), type="negative", multi_line=True, close_button=self.say("Close"), timeout=10_000)
            return None
        if not quiet:
            ui.notify(done.words, type="positive", multi_line=True)
        self.refresh()
        return done

    def every_look(self, refresh: Callable[[], None], owner: ui.element | None = None) -> None:
        """Call something now, twice a second, and at once after each deed, as long as page and owner are there."""
        refresh()
        self.refreshers.append((refresh, owner))

    def refresh(self) -> None:
        """Look again now."""
        self.refreshers = [
            (refresh, owner) for refresh, owner in self.refreshers if owner is None or not owner.is_deleted
        ]
        for refresher in tuple(self.refreshers):
            refresh, owner = refresher
            if owner is not None and owner.is_deleted:
                continue  # by a refresher before it
            try:
                refresh()
            except NotThere:
                self.refreshers = [one for one in self.refreshers if one is not refresher]
            except MsbotError as error:
                self._say_once(str(error))

    def check_session(self) -> None:
        """Leave the page when its session has ended."""
        try:
            is_over = bool(self.session.token) and not self.service.accounts.holds(self.session)
        except MsbotError as error:  # the database cannot be read at present
            self._say_once(str(error))
            return
        if is_over:
            self.refreshers.clear()
            ui.run_javascript("msbotSignIn()")

    def _say_once(self, words: str) -> None:
        """What cannot be shown now is tried again at the next look; the log says so when it begins."""
        if words != self.trouble:
            self.trouble = words
            _log.warning("the page of %s shows what it showed before: %s", self.session.name, words)


@contextmanager
def page_frame(service: Service, request: Request, path: str, title: str) -> Iterator[Page]:
    """Everything around a page's content.

    Args:
        service: what the page is about.
        request: who opens it; the guard has put the session there.
        path: which entry of the menu it is.
        title: its heading.
    """
    session = request.scope["state"]["session"]
    page = Page(service, session, language_of(request))
    ui.add_head_html('<link rel="stylesheet" href="/web/msbot.css"><script src="/web/session.js"></script>')
    ui.add_body_html(f'<a class="skip" href="#content">{escape(page.say("Skip to the content"))}</a>')
    ui.page_title(f"{page.say(title)} · {service.robot_name}")
    ui.run_javascript(f'document.documentElement.lang = "{page.language.code}"')
    dark = ui.dark_mode(_dark_of(request))
    ui.colors(
        primary="#0b6e99",
        positive="#1b7a3d",
        negative="#b3261e",
        warning="#8a5a00",
        dark="#17212a",
        dark_page="#0e151b",
    )
    with ui.header().classes("ms-header").props("role=banner"):
        menu = ui.button(icon="menu").props(f'flat round dense color=primary aria-label="{page.say("Menu")}"')
        ui.label(service.robot_name).classes("ms-robot")
        _who(page, dark)
        ui.button(page.say("STOP"), on_click=partial(press_stop, page), color=None).classes("ms-stop").props(
            f'unelevated aria-label="{page.say("STOP: every part goes to its safe state (press Escape twice)")}"'
        )
    # Not value=None: NiceGUI would ask a slow browser whether it is open, and log when no answer comes in a second.
    with ui.left_drawer(value=False, bordered=False).classes("ms-nav").props(
        "show-if-above width=210 breakpoint=900 role=navigation"
    ) as drawer:  # fmt: skip
        _menu(page, path)
    menu.on_click(drawer.toggle)
    _escape_twice(page)
    with ui.column().classes("w-full").style("gap: 1rem").props("role=main id=content tabindex=-1"):
        banner = ui.column().classes("w-full ms-banners").style("gap:.5rem")
        _banner(page, banner)
        ui.html(f"<h1>{page.say(title)}</h1>", sanitize=False)
        yield page
    ui.timer(LOOK_S, page.refresh)
    ui.timer(CHECK_S, page.check_session)


def press_stop(page: Page) -> None:
    """STOP, and say how long it took."""
    done = page.do(lambda session: page.service.stop(session, ""), quiet=True)
    if done is not None:
        took = "" if done.latency_ms is None else f" ({done.latency_ms:.1f} ms)"
        ui.notify(f"{done.words}{took}", type="warning", multi_line=True, timeout=8000)


def file_button(
    page: Page, title: str, taken: Callable[[UploadEventArguments], Awaitable[None]], *, max_size: int, ending: str = ""
) -> None:
    """A button that takes a file from the person's computer.

    Args:
        page: where.
        title: what is on it.
        taken: what is done with the file.
        max_size: octets that it may have.
        ending: of the file's name.
    """
    upload = ui.upload(on_upload=taken, auto_upload=True, max_file_size=max_size, on_rejected=lambda: ui.notify(
        page.say("This file is not taken: at most {size} kB{ending}.", size=f"{max_size // 1000:,}",
                 ending=ending and f", *{ending}"), type="negative")).classes("hidden")  # fmt: skip
    upload.props["headers"] = [{"name": CSRF_HEADER, "value": page.session.csrf}]
    if ending:
        upload.props(f"accept={ending}")
    # Without a detour by the server: browsers open the dialog only in answer to a click.
    ui.button(title, icon="upload_file").props("outline").on(
        "click", js_handler=f"() => getElement({upload.id}).pickFiles()"
    )


def _menu(page: Page, path: str) -> None:
    for way in MENU:
        if not page.may(way.right):
            continue
        with ui.link(target=way.path).props('aria-current="page"' if way.path == path else ""):
            ui.icon(way.icon, size="1.3rem").props("aria-hidden=true")
            ui.label(page.say(way.title))
            if way.path == "/arrivals":
                count = ui.label("").classes("count")

                def show(count: ui.label = count) -> None:
                    waiting = page.service.robot().arrivals
                    count.set_text(str(waiting))
                    count.set_visibility(waiting > 0)

                page.every_look(show)


def _who(page: Page, dark: ui.dark_mode) -> None:
    with (
        ui.button(icon="account_circle").props(f'flat round dense color=primary aria-label="{page.say("You")}"'),
        ui.menu(),
    ):
        ui.label(f"{page.session.name} · {page.say(page.session.role.word)}").classes("soft").style(
            "padding:.5rem 1rem"
        )
        for mode, title in ((None, "As the device"), (False, "Light"), (True, "Dark")):
            ui.menu_item(page.say(title), partial(_set_dark, dark, mode))
        ui.separator()
        for language in languages().values():
            ui.menu_item(language.name, partial(_set_language, language.code))
        ui.separator()
        ui.menu_item(page.say("API"), lambda: ui.navigate.to("/api-docs"))
        ui.menu_item(page.say("Sign out"), lambda: ui.run_javascript(
            "const f=document.createElement('form');f.method='post';f.action='/logout';document.body.append(f);f.submit()"
        ))  # fmt: skip


def _banner(page: Page, banner: ui.column) -> None:
    shown: list[tuple[str, str]] = []

    def show() -> None:
        robot = page.service.robot()
        wanted = []
        if robot.stopped:
            wanted.append(("bad", page.say("STOP is in force: every part is in its safe state.")))
        if robot.trouble:
            wanted.append(("warn", robot.trouble))
        if wanted == shown:
            return
        shown[:] = wanted
        banner.clear()
        with banner:
            for kind, words in wanted:
                with ui.element("div").classes(f"ms-banner {kind} row spread").props("role=alert"):
                    ui.label(words)
                    if kind == "bad" and page.may(Right.ARRANGE):
                        ui.button(page.say("Go on"), on_click=lambda: page.do(page.service.go_on)).props(
                            "outline dense"
                        )

    page.every_look(show)


def _escape_twice(page: Page) -> None:
    pressed = [float("-inf")]

    def key(event: KeyEventArguments) -> None:
        if not event.action.keydown or event.action.repeat or event.key != "Escape":
            return
        now = asyncio.get_running_loop().time()
        if now - pressed[0] <= TWICE_S:
            pressed[0] = float("-inf")
            press_stop(page)
        else:
            pressed[0] = now

    ui.keyboard(key, ignore=[])


def _dark_of(request: Request) -> bool | None:
    return {"light": False, "dark": True}.get(request.cookies.get("msbot_look", ""))


def _set_dark(dark: ui.dark_mode, mode: bool | None) -> None:
    dark.value = mode
    word = {None: "", False: "light", True: "dark"}[mode]
    ui.run_javascript(f"document.cookie = 'msbot_look={word};path=/;max-age=31536000;samesite=lax'")


def _set_language(code: str) -> None:
    ui.run_javascript(
        f"document.cookie = '{LANGUAGE_COOKIE}={code};path=/;max-age=31536000;samesite=lax'; location.reload()"
    )
