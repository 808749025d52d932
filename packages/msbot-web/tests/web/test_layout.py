"""A page that is open: what it looks at, what it leaves out, and when it ends; without a browser."""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path

import pytest
from nicegui import Client, ui

from msbot.operations.rights import Right, Role
from msbot_web.access.sessions import Session
from msbot_web.language import languages
from msbot_web.models.robot_models import ChangeResult
from msbot_web.pages import page as page_module
from msbot_web.pages.page import Page
from msbot_xrce.errors import NotThere, RegistryError
from tests.web.rig import Rig, show


class Screen:
    """What NiceGUI is asked to show."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.notes: list[str] = []
        self.scripts: list[str] = []
        monkeypatch.setattr(ui, "notify", lambda words, **_: self.notes.append(words))
        monkeypatch.setattr(ui, "run_javascript", self.scripts.append)


@pytest.fixture
def screen(monkeypatch: pytest.MonkeyPatch) -> Screen:
    return Screen(monkeypatch)


def open_page(rig: Rig, role: Role = Role.TEACHER) -> Page:
    return Page(rig.service, rig.session(role), languages()["en"])


def test_what_has_vanished_is_looked_at_no_more_and_the_rest_goes_on(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        page, looks = open_page(rig), {"gone": 0, "here": 0}

        def gone() -> None:
            looks["gone"] += 1
            if looks["gone"] > 1:
                raise NotThere("there is no slot 'x'")

        def here() -> None:
            looks["here"] += 1

        page.every_look(gone)
        page.every_look(here)
        for _ in range(3):
            page.refresh()
        assert looks == {"gone": 2, "here": 4}

    show(tmp_path, scene, parts=())


def test_trouble_with_the_database_is_logged_once_and_tried_again(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async def scene(rig: Rig) -> None:
        page, looks = open_page(rig), [0]

        def look() -> None:
            looks[0] += 1
            if 1 < looks[0] < 10:
                raise RegistryError("the database is locked")

        page.every_look(look)
        with caplog.at_level(logging.WARNING, logger=page_module.__name__):
            for _ in range(20):
                page.refresh()
        assert looks == [21]
        said = [record.getMessage() for record in caplog.records if record.name == page_module.__name__]
        assert said == ["the page of teacher shows what it showed before: the database is locked"]

    show(tmp_path, scene, parts=())


def test_a_deed_is_told_refused_in_words_or_leads_to_the_sign_in(tmp_path: Path, screen: Screen) -> None:
    async def scene(rig: Rig) -> None:
        page, looks = open_page(rig), []
        page.every_look(lambda: looks.append(rig.stage.now()))
        assert await page.act("window", seconds=9.0) is not None
        assert len(looks) == 2  # at once, not at the next look
        assert await page.do(lambda _: ChangeResult(words="quietly"), quiet=True) is not None
        assert await page.do(lambda session: rig.service.remove_user(session, "student")) is None
        assert len(screen.notes) == 2
        assert screen.notes[1] == "a teacher may not administer users, keys and backups; an administrator may"
        rig.accounts.sign_out(page.session)
        assert await page.act("window", seconds=9.0) is None
        assert screen.scripts == ["msbotSignIn()"]

    show(tmp_path, scene, parts=())


def test_a_page_ends_with_its_session_and_looking_keeps_none_alive(tmp_path: Path, screen: Screen) -> None:
    async def scene(rig: Rig) -> None:
        page, idle = open_page(rig, Role.STUDENT), open_page(rig, Role.VIEWER)
        page.every_look(lambda: None)
        used_at = idle.session.used_at
        await asyncio.sleep(60.0)
        for one in (page, idle):
            one.check_session()
        assert screen.scripts == []
        assert idle.session.used_at == used_at
        assert page.may(Right.SET)
        await rig.accounts.change_role("student", "viewer", who="ada")
        page.check_session()
        assert not page.may(Right.SET)
        await rig.accounts.remove_user("student", who="ada")
        page.check_session()
        assert screen.scripts == ["msbotSignIn()"]
        assert page.refreshers == []

    show(tmp_path, scene, parts=())


def test_nothing_is_shown_on_a_page_that_was_closed_while_something_was_read(
    tmp_path: Path, screen: Screen, caplog: pytest.LogCaptureFixture
) -> None:
    async def scene(rig: Rig) -> None:
        client = Client(ui.page("/closed"), request=None)
        page, shown, answer = open_page(rig), [], asyncio.Event()
        page.client = client
        client.on_delete(page.closed)
        with client:
            label = ui.label("reading")

        async def show_answer() -> None:
            await answer.wait()
            label.set_text("read")
            shown.append("read")

        async def deed(_: Session) -> ChangeResult:
            await answer.wait()
            return ChangeResult(words="done")

        page.every_look(show_answer)
        doing = asyncio.create_task(page.do(deed))
        await asyncio.sleep(1.0)
        client.delete()
        answer.set()
        assert await doing == ChangeResult(words="done")
        await asyncio.sleep(1.0)
        assert shown == screen.notes == []
        assert not page.tasks

    show(tmp_path, scene, parts=())
    assert "deleted" not in caplog.text
