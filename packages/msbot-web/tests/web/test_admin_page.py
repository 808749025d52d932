"""The page Admin, without a browser."""

from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path

import pytest
from nicegui import Client, ui
from nicegui.elements.upload_files import SmallFileUpload
from nicegui.page import page as nicegui_page

from msbot.operations.rights import Role
from msbot_web.access.sessions import Session
from msbot_web.language import languages
from msbot_web.models.robot_models import ChangeResult
from msbot_web.pages import admin
from msbot_web.pages.page import Page
from msbot_web.service import Service
from msbot_xrce.errors import ConfigError
from tests.web.rig import Rig, ToyBench, show


@pytest.mark.parametrize("is_backup", [True, False])
def test_a_backup_that_is_handed_in_is_seen_being_checked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_backup: bool
) -> None:
    told: list[str] = []
    monkeypatch.setattr(ui, "notify", lambda words, **_: told.append(words))

    async def scene(rig: Rig) -> None:
        with Client(nicegui_page("/")):
            shown = admin._Backup(Page(rig.service, rig.session(Role.ADMINISTRATOR), languages()["de"]))

            async def restore(_service: Service, _session: Session, backup: AsyncIterator[bytes]) -> ChangeResult:
                assert shown._button.props["loading"]  # and takes no second click
                assert shown._state.text == "monday.db (1,5 MB) wird geprüft ..."
                assert len(b"".join([octets async for octets in backup])) == 1_500_000
                if not is_backup:
                    raise ConfigError("this is no backup")
                return ChangeResult(words="It is kept.")

            monkeypatch.setattr(Service, "restore", restore)
            await shown._restore(SmallFileUpload("monday.db", "", b"." * 1_500_000))
            assert "loading" not in shown._button.props
            assert shown._state.text == ("It is kept." if is_backup else "")
            assert told == ["It is kept." if is_backup else "this is no backup"]

    show(tmp_path, scene, bench=ToyBench())
