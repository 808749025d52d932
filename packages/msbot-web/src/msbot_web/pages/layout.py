"""What surrounds every page: the robot's name, links to the other pages, STOP, and who is signed in."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

from fastapi import Request
from nicegui import ui

from msbot_web.html import render
from msbot_web.language import COOKIE as LANGUAGE_COOKIE
from msbot_web.language import language_of, languages
from msbot_web.pages.banner import show_banner
from msbot_web.pages.class_banner import raise_hand_button, show_class_banner
from msbot_web.pages.easy_reading import is_easy, read_easily
from msbot_web.pages.lesson_panel import show_lesson_panel
from msbot_web.pages.menu import search_button, show_menu
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import menu_item
from msbot_web.pages.page_help import help_button, offer_tour
from msbot_web.pages.time_slider import PATHS, TimeSlider, work_of
from msbot_web.root_path import root
from msbot_web.service import Service

_log = logging.getLogger(__name__)

BUILD_S = 30.0
"""Longest time in which a page that waits while it is laid out must be there.

NiceGUI's own 3 s were an error page on a slow computer.
"""


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
    page = Page(service, session, language_of(request), is_easy(request), client=ui.context.client)
    ui.context.client.on_delete(page.closed)
    ui.context.client.on_disconnect(page.let_go)
    ui.add_head_html(str(render("head", language=page.language.code, easy=page.easy)))
    # As a plain text: to markup NiceGUI could not add its own, which would be shown as text.
    # Its script runs after socket.io and NiceGUI are there and before they connect.
    channel = f'<script defer src="{root()}/web/channel.js"></script>'
    ui.add_body_html(str(render("stop", say=page.translate, csrf=session.csrf)) + channel)
    ui.page_title(f"{page.translate(title)} · {service.robot_name}")
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
        menu = (
            ui.button(icon="menu")
            .props(f'flat round dense color=primary aria-label="{page.translate("Menu")}"')
            .classes("ms-menu")
        )
        ui.label(service.robot_name).classes("ms-robot")
        raise_hand_button(page)
        search_button(page)
        help_button(page, path)
        _who(page, dark)
    show_menu(page, path, menu)
    with ui.column().classes("w-full").style("gap: 1rem").props("id=content tabindex=-1"):
        banner = ui.column().classes("w-full ms-banners").style("gap:.5rem")
        show_banner(page, banner)
        show_class_banner(page, ui.column().classes("w-full ms-banners"))
        if path == "/":
            offer_tour(page, request)
        ui.html(render("title", words=page.translate(title)), sanitize=False)
        if path in PATHS:
            asked = request.query_params
            work = work_of(asked.get("work", ""), path)
            page.time_slider = TimeSlider(page, asked.get("at", ""), reads=path != "/plots", work=work)
        yield page
    show_lesson_panel(page, path)
    service.live.add(page.client_id, page)


def _who(page: Page, dark: ui.dark_mode) -> None:
    with (
        ui.button(icon="account_circle").props(f'flat round dense color=primary aria-label="{page.translate("You")}"'),
        ui.menu(),
    ):
        ui.label(f"{page.session.name} · {page.translate(page.session.role.word)}").classes("soft").style(
            "padding:.5rem 1rem"
        )
        for mode, title in ((None, "As the device"), (False, "Light"), (True, "Dark")):
            menu_item(page.translate(title), partial(_set_dark, dark, mode))
        ui.separator()
        easy = page.translate("Ordinary text") if page.easy else page.translate("Easy to read")
        menu_item(easy, partial(read_easily, easy=not page.easy))
        ui.separator()
        for language in languages().values():
            menu_item(language.name, partial(_set_language, language.code))
        ui.separator()
        menu_item(page.translate("API"), lambda: ui.navigate.to("/api-docs"))
        menu_item(
            page.translate("Sign out"),
            lambda: ui.run_javascript(
                "const f=document.createElement('form');f.method='post';f.action=msbotAt('/logout');document.body.append(f);f.submit()"
            ),
        )


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
