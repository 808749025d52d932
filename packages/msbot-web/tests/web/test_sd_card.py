"""The panel of a Raspberry Pi that runs from a card of MsBOT, and its calls: against the card's own helper."""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest
from msbot_card import requests
from msbot_card.settings import CAN_HATS
from msbot_card.system import System
from nicegui import Client, ui
from nicegui.page import page as nicegui_page

from msbot.operations.rights import Role
from msbot_web.access.accounts import NotAllowed
from msbot_web.language import languages
from msbot_web.pages.card_panel import HATS, TOLD, CardPanel
from msbot_web.pages.page import Page
from msbot_web.sd_card import REASONS, CardChange, CardHardware, CardWifi, SdCard
from msbot_xrce.errors import ConfigError, NotThere
from tests.web.rig import Rig, ToyBench, show


class Quiet(System):
    """A card whose helper starts no programs."""

    def _run(self, *command: str, user: str | None = None, stdin: str = "") -> str | None:
        return ""


@pytest.fixture
def card(tmp_path: Path) -> Iterator[SdCard]:
    """A card, and its helper in a thread."""
    root = tmp_path / "root"
    for name in ("boot/firmware", "data/card", "var/lib/msbot", "etc/msbot", "etc/wpa_supplicant", "dev"):
        (root / name).mkdir(parents=True)
    (root / "boot/firmware/config.txt").write_text("[all]\n")
    listening = socket.socket(socket.AF_UNIX)
    listening.bind(str(tmp_path / "socket"))
    listening.listen()
    over = threading.Event()

    def serve() -> None:
        while not over.is_set():
            requests.serve(listening, Quiet(root), idle_s=0.1)

    thread = threading.Thread(target=serve)
    thread.start()
    yield SdCard(tmp_path / "socket", root / "var/lib/msbot/update.deb")
    over.set()
    thread.join()
    listening.close()


async def octets(*pieces: bytes) -> AsyncIterator[bytes]:
    for piece in pieces:
        yield piece


async def test_what_is_set_comes_back_without_the_password(card: SdCard) -> None:
    assert card.is_there
    wifi = CardWifi(country="DE", network="School", password="correct horse")
    state = await card.change(CardChange(name="lab", wifi=wifi, hardware=CardHardware(can="mcp2515-8mhz")))
    assert (state.settings.name, state.settings.network, state.settings.has_key) == ("lab", "School", True)
    assert "correct" not in state.model_dump_json()
    assert (await card.state()).settings == state.settings


async def test_what_the_helper_refuses_is_said_in_words_that_are_translated(card: SdCard) -> None:
    with pytest.raises(ConfigError, match="small letters, digits and hyphens"):
        await card.change(CardChange(name="No Name"))
    with pytest.raises(ConfigError, match="There is no former version"):
        await card.go_back()
    with pytest.raises(ConfigError, match="This file is no update"):
        await card.update(octets(b"no ", b"package"), "0.1.0")
    for reason in REASONS.values():
        for language in ("de", "fr"):
            assert languages()[language].translate(reason) != reason


async def test_a_computer_without_such_a_card_says_so(tmp_path: Path) -> None:
    other = SdCard(tmp_path / "nowhere")
    assert not other.is_there
    with pytest.raises(NotThere, match="does not run from a card of MsBOT"):
        await other.state()
    gone = socket.socket(socket.AF_UNIX)
    gone.bind(str(tmp_path / "gone"))
    gone.close()
    with pytest.raises(ConfigError, match="does not answer"):
        await SdCard(tmp_path / "gone").state()


def test_only_an_administrator_sees_and_sets_the_card(tmp_path: Path, card: SdCard) -> None:
    async def scene(rig: Rig) -> None:
        rig.service._card = card
        teacher, administrator = rig.session(Role.TEACHER), rig.session(Role.ADMINISTRATOR)
        assert not rig.service.has_card(teacher)
        assert rig.service.has_card(administrator)
        with pytest.raises(NotAllowed):
            await rig.service.card(teacher)
        with pytest.raises(NotAllowed):
            await rig.service.change_card(teacher, CardChange(name="mine"))
        with pytest.raises(NotAllowed):
            await rig.service.restart_computer(teacher)

    (tmp_path / "robot").mkdir(exist_ok=True)
    show(tmp_path / "robot", scene, bench=ToyBench())


@pytest.mark.parametrize("language", ["en", "de", "fr"])
def test_the_panel_shows_what_is_set(language: str, tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        rig.service._card = card = SdCard(tmp_path / "nowhere")
        with Client(nicegui_page("/")) as client:
            page = Page(rig.service, rig.session(Role.ADMINISTRATOR), languages()[language])
            panel = CardPanel(page)
            await panel.show()  # no card: a sentence
            assert not card.is_there
            words = [one.text for one in client.elements.values() if isinstance(one, ui.label)]
            assert page.translate("this computer does not run from a card of MsBOT") in words

    (tmp_path / "robot").mkdir(exist_ok=True)
    show(tmp_path / "robot", scene, bench=ToyBench())


def test_the_panel_has_every_hat_of_the_helper() -> None:
    assert list(HATS) == list(CAN_HATS)
    assert set(TOLD) == {"updated", "fell back", "went back"}


async def test_two_updates_at_once_are_one_too_many(card: SdCard) -> None:
    begun, go_on = asyncio.Event(), asyncio.Event()

    async def slow() -> AsyncIterator[bytes]:
        begun.set()
        await go_on.wait()
        yield b"no package"

    first = asyncio.create_task(card.update(slow(), "0.1.0"))
    await begun.wait()
    with pytest.raises(ConfigError, match="is being tried"):
        await card.update(octets(b""), "0.1.0")
    go_on.set()
    with pytest.raises(ConfigError, match="no update"):
        await first
