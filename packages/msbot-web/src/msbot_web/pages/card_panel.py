"""What an administrator sets about a Raspberry Pi that runs from a card of MsBOT: name, Wi-Fi, hats, version."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from nicegui import ui
from nicegui.events import UploadEventArguments

from msbot_agent.text.sentence import said
from msbot_web.access.access_middleware import MAX_RESTORE
from msbot_web.pages.page import Page
from msbot_web.pages.page_elements import ask_first, file_button, heading, panel
from msbot_web.sd_card import CardChange, CardHardware, CardState, CardWifi
from msbot_xrce.errors import MsbotError

if TYPE_CHECKING:
    from nicegui.elements.upload_files import FileUpload

HATS = {
    "none": said("none"),
    "mcp2515-8mhz": "MCP2515, 8 MHz",
    "mcp2515-12mhz": "MCP2515, 12 MHz",
    "mcp2515-16mhz": "MCP2515, 16 MHz",
    "mcp2518fd-20mhz": "MCP2517FD / MCP2518FD, 20 MHz",
    "mcp2518fd-40mhz": "MCP2517FD / MCP2518FD, 40 MHz",
}
BITRATES = (125_000, 250_000, 500_000, 1_000_000)
TOLD = {
    "updated": said("The update is well."),
    "fell back": said("The update did not start well: the former version is back, with its database."),
    "went back": said("The former version is back, with its database."),
}


class CardPanel:
    """The panel "This computer", where it runs from such a card.

    Args:
        page: where it is shown.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        say = page.translate
        with panel():
            heading(say("This computer"))
            self._body = ui.column().classes("w-full")
        with self._body:
            ui.label(say("One moment ...")).classes("soft")
        ui.timer(0.05, self.show, once=True)

    async def show(self) -> None:
        """Read the card and show it."""
        page = self._page
        try:
            state = await page.service.card(page.session)
        except MsbotError as error:
            self._body.clear()
            with self._body:
                ui.label(page.translate(str(error))).classes("ms-banner warn")
            return
        self._body.clear()
        with self._body:
            self._settings(state)
            self._version(state)

    def _settings(self, state: CardState) -> None:
        page, say, settings = self._page, self._page.translate, state.settings
        if state.mistakes:
            ui.label(state.mistakes).classes("ms-banner warn").style("white-space:pre-line")
        with ui.element("div").classes("row").style("margin-top:.4rem;align-items:center"):
            name = ui.input(say("Name in the network"), value=settings.name).props("dense outlined maxlength=63")
            ui.label(".local")
        with ui.element("div").classes("row").style("margin-top:.8rem;align-items:flex-end"):
            country = ui.input(say("Wi-Fi: country"), value=settings.country).props("dense outlined maxlength=2")
            country.style("width:8rem")
            network = ui.input(say("Wi-Fi: network"), value=settings.network).props("dense outlined maxlength=32")
            password = ui.input(say("Wi-Fi: password"), password=True).props(
                "dense outlined maxlength=63 autocomplete=new-password"
            )
            if settings.has_key:
                password.props["hint"] = say("Empty: as it is.")
        if not state.wifi:
            ui.label(say("No Wi-Fi adapter has been found.")).classes("soft")
        with ui.element("div").classes("row").style("margin-top:.8rem;align-items:flex-end"):
            hats = {key: say(words) for key, words in HATS.items()}
            hat = ui.select(hats, value=settings.can, label=say("CAN hat: chip and crystal")).props("dense outlined")
            hat.style("min-width:16rem")
            rates = {rate: f"{rate // 1000} kbit/s" for rate in sorted({*BITRATES, settings.can_bitrate})}
            rate = ui.select(rates, value=settings.can_bitrate, label=say("Bit rate")).props("dense outlined")
            i2c = ui.checkbox(say("I2C at the pins 3 and 5"), value=settings.i2c)
        if settings.can != "none" and not state.can:
            ui.label(say("The CAN hat has not been found: it needs a restart, or has another chip.")).classes("soft")

        async def keep() -> None:
            wifi = None
            wanted = (str(country.value or "").strip().upper(), str(network.value or ""))
            if wanted != (settings.country, settings.network) or password.value:
                wifi = CardWifi(country=wanted[0], network=wanted[1], password=str(password.value or "") or None)
            change = CardChange(
                name=str(name.value or "").strip().lower(),
                wifi=wifi,
                hardware=CardHardware(i2c=bool(i2c.value), can=str(hat.value), can_bitrate=int(rate.value)),
            )
            if await page.do(lambda session: page.service.change_card(session, change)) is not None:
                await self.show()

        with ui.element("div").classes("row").style("margin-top:.8rem"):
            ui.button(say("Save"), on_click=keep)
            ui.button(say("Restart the computer"), icon="restart_alt", on_click=self._ask_restart).props("flat")
        ui.label(say("A hat, I2C and a version take effect with a restart; a name and a Wi-Fi at once.")).classes(
            "soft"
        )

    def _version(self, state: CardState) -> None:
        say, versions = self._page.translate, state.versions
        of_image = say("that of the image")
        ui.label(say("MsBOT: {version}", version=versions.current or of_image)).style("margin-top:1rem;font-weight:600")
        if versions.back:
            ui.label(say("The next start goes back to the former version."))
        elif versions.trial:
            ui.label(
                say("An update is being tried: wait until it is done.")
                if versions.starts
                else say("It runs from the next start on.")
            )
        elif versions.told in TOLD:
            ui.label(say(TOLD[versions.told]))
        with ui.element("div").classes("row"):
            file_button(self._page, say("Update"), self._ask_update, max_size=MAX_RESTORE, ending=".deb")
            if versions.current and not versions.back:
                former = versions.former or of_image
                words = say("Back to {version}", version=former)
                ui.button(words, icon="undo", on_click=self._ask_back).props("flat")
        ui.label(say("An update is MsBOT alone. For a newer Debian, flash the card anew.")).classes("soft")

    def _ask_restart(self) -> None:
        page = self._page
        words = page.translate("Restart the computer? The robot stands still for about a minute.")
        ask_first(page, words, lambda: page.do(page.service.restart_computer))

    def _ask_back(self) -> None:
        page = self._page
        words = page.translate(
            "Go back? The database is then that from before the update; the present one is kept beside it."
        )

        async def back() -> None:
            if await page.do(page.service.card_back) is not None:
                await self.show()

        ask_first(page, words, back)

    async def _ask_update(self, event: UploadEventArguments) -> None:
        words = self._page.translate("Take {name} in? It runs from the next start on.", name=event.file.name)
        ask_first(self._page, words, partial(self._update, event.file))

    async def _update(self, file: FileUpload) -> None:
        page = self._page
        if await page.do(lambda session: page.service.update_card(session, file.iterate())) is not None:
            await self.show()
