"""Who drives by hand on the page of the arena: the pilot stays plugged in only for those who may drive."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest
from nicegui import Client
from nicegui.events import GenericEventArguments

from msbot.operations.rights import Role
from msbot_web.arena_view import ArenaView
from msbot_web.language import languages
from msbot_web.models.robot_models import Scalar
from msbot_web.page_errors import NotFromOurPage
from msbot_web.pages.arena import _ArenaPage
from msbot_web.pages.page import Page
from tests.web.rig import Rig, ToyBench, show


class Motors(ToyBench):
    """It takes powers."""

    def operate(self, slot: str, control: str, value: Scalar) -> None:
        self.turned[slot] = value


class Closed:
    """A browser's page that hears, and on which nothing is shown any more."""

    has_socket_connection = is_deleted = True


def arena_page(rig: Rig, role: Role, view: ArenaView) -> _ArenaPage:
    """The page, without what is drawn on it."""
    made = _ArenaPage.__new__(_ArenaPage)
    made._page = Page(rig.service, rig.session(role), languages()["en"])
    made._page.client = cast("Client", Closed())
    made._arena, made._pilot, made._driven_at = view, "AA", None
    return made


def told(args: object) -> GenericEventArguments:
    return cast("GenericEventArguments", SimpleNamespace(args=args))


def test_who_may_not_drive_keeps_no_pilot_plugged_in(tmp_path: Path) -> None:
    bench = Motors("AA")

    async def scene(rig: Rig) -> None:
        view = ArenaView(None)
        student, viewer = (arena_page(rig, role, view) for role in (Role.STUDENT, Role.VIEWER))
        await student._plug_pilot()
        assert view.drivers == {student._page.client}
        await viewer._drive(told([100, 100, 0]))
        assert view.drivers == {student._page.client}
        other = arena_page(rig, Role.TEACHER, view)
        await other._drive(told([0, 0, 0]))
        assert view.drivers == {student._page.client, other._page.client}
        odd: object
        for odd in (None, 1, {}, ["x"], [None], [[]]):
            with pytest.raises(NotFromOurPage):
                await student._drive(told(odd))
            with pytest.raises(NotFromOurPage):
                await student._put(told(odd))
        other._closed()
        assert bench.is_plugged("AA")
        student._closed()
        assert not bench.is_plugged("AA")

    show(tmp_path, scene, bench=bench)
