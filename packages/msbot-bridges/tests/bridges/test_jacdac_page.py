"""Modules that the genuine jacdac-ts simulates in a real browser, on the bridge's own page."""

from __future__ import annotations

import asyncio
import os
import shutil
from collections.abc import AsyncIterator
from contextlib import suppress

import pytest
from playwright.async_api import Browser, Page, async_playwright
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus

from msbot.part import Message
from msbot.part.messages.standard import Angle, Switch
from msbot_bridges.bridge import BridgeLink
from msbot_bridges.jacdac.jacdac_world import JacdacWorld
from msbot_bridges.jacdac.world import open_world
from msbot_xrce.errors import ConfigError, LinkDown

from .hosts import Host

NAMES = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
SERVER = "bus.serviceProviders()[0].services().find(one => one.specification.shortId == '%s')"


@pytest.fixture
async def browser() -> AsyncIterator[Browser]:
    path = next(filter(None, map(shutil.which, NAMES)), None)
    if path is None:
        (pytest.fail if os.environ.get("MSBOT_NEED_BROWSER") else pytest.skip)("no Chromium on this machine")
    async with async_playwright() as playwright:
        found = await playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield found
        await found.close()


async def until(page: Page, condition: str) -> None:
    """The page's own policy forbids Playwright's way of waiting."""
    while not await page.evaluate(condition):
        await page.wait_for_timeout(20)


@pytest.fixture
async def world() -> AsyncIterator[tuple[JacdacWorld, Host]]:
    world, host = open_world(BridgeLink("page:0")), Host()
    assert isinstance(world, JacdacWorld)
    running = asyncio.create_task(world.run(host))
    await world.is_open.wait()
    yield world, host
    running.cancel()
    await asyncio.wait([running])


async def simulated(browser: Browser, world: JacdacWorld, kind: str) -> Page:
    page = await browser.new_page()
    page.set_default_timeout(120_000)
    failures: list[str] = []
    page.on("pageerror", lambda error: failures.append(str(error)))
    await page.goto(f"http://127.0.0.1:{world.port}/")
    await page.get_by_text("Connected to the bridge").wait_for()
    await page.get_by_label("Simulate a module").select_option(kind)
    await page.get_by_role("button", name="Add").click()
    assert failures == []
    return page


async def test_a_servo_is_found_driven_stopped_and_missed(browser: Browser, world: tuple[JacdacWorld, Host]) -> None:
    async with asyncio.timeout(300):
        page = await simulated(browser, world[0], "servo")
        server = SERVER % "servo"
        await page.get_by_text("servo", exact=False).locator("visible=true").last.wait_for()
        device = await world[1].devices.get()
        assert device.identity.part_number == "jacdac:servo"
        assert [(one.name, one.message, one.safe) for one in device.inputs] == [("angle", Angle, None)]
        assert [(one.name, one.default, one.least, one.most) for one in device.settings] == [
            ("angle_offset", 0.0, -90.0, 90.0)
        ]
        assert await page.evaluate(f"{server}.enabled.values()[0]") in (0, False), "nothing was told to it yet"
        device.begin(lambda _port, _message: None)
        device.set("angle_offset", 5.0)
        device.act("angle", Angle(degrees=40))
        await until(page, f"Math.abs({server}.angle.values()[0] - 40) < 0.5")
        assert await page.evaluate(f"{server}.offset.values()[0]") == 5
        assert await page.evaluate(f"!!{server}.enabled.values()[0]")
        device.stop()
        assert device.not_stopped == "angle has not reported that its power is off"
        while device.not_stopped:
            world[1].told.clear()
            device.stop()
            with suppress(TimeoutError):
                async with asyncio.timeout(1):
                    await world[1].told.wait()
        assert not await page.evaluate(f"!!{server}.enabled.values()[0]")
        device.act("angle", Angle(degrees=90))
        device.go()
        device.act("angle", Angle(degrees=10))
        await until(page, f"Math.abs({server}.angle.values()[0] - 10) < 0.5")
        await page.close()
        assert (await world[1].lost_why.get()).endswith("it has sent nothing for 2 s")


async def test_a_servo_holds_the_safe_value_of_its_slot_with_power(
    browser: Browser, world: tuple[JacdacWorld, Host]
) -> None:
    async with asyncio.timeout(300):
        page = await simulated(browser, world[0], "servo")
        server = SERVER % "servo"
        device = await world[1].devices.get()
        device.begin(lambda _port, _message: None)
        device.act("angle", Angle(degrees=40))
        await until(page, f"Math.abs({server}.angle.values()[0] - 40) < 0.5")
        device.safe_is("angle", Angle(degrees=120))
        device.stop()
        assert device.not_stopped == "angle has not reported its safe value"
        while device.not_stopped:
            world[1].told.clear()
            device.stop()
            with suppress(TimeoutError):
                async with asyncio.timeout(1):
                    await world[1].told.wait()
        assert await page.evaluate(f"{server}.angle.values()[0]") == 120
        assert await page.evaluate(f"!!{server}.enabled.values()[0]")
        device.go()
        device.act("angle", Angle(degrees=40))
        await until(page, f"Math.abs({server}.angle.values()[0] - 40) < 0.5")
        device.rests_at("angle", Angle(degrees=20))
        device.rest()
        await until(page, f"Math.abs({server}.angle.values()[0] - 20) < 0.5")
        await page.close()


async def test_a_button_is_heard_at_once(browser: Browser, world: tuple[JacdacWorld, Host]) -> None:
    async with asyncio.timeout(300):
        page = await simulated(browser, world[0], "button")
        device = await world[1].devices.get()
        heard = asyncio.Queue[Message]()
        device.begin(lambda _port, message: heard.put_nowait(message))
        await page.evaluate(f"{SERVER % 'button'}.down()")
        while await heard.get() != Switch(on=True):
            pass
        await page.evaluate(f"{SERVER % 'button'}.up()")
        while await heard.get() != Switch(on=False):
            pass


async def test_a_page_of_somebody_else_does_not_come_in(world: tuple[JacdacWorld, Host]) -> None:
    url = f"ws://127.0.0.1:{world[0].port}/frames"
    async with connect(url, origin=None):
        pass
    for headers in ({"Origin": "http://evil.example"}, {"Origin": "null"}):
        with pytest.raises(InvalidStatus) as refused:
            async with connect(url, additional_headers=headers):
                pass
        assert refused.value.response.status_code == 403


async def test_what_is_no_frame_is_said_once(world: tuple[JacdacWorld, Host]) -> None:
    async with asyncio.timeout(60), connect(f"ws://127.0.0.1:{world[0].port}/frames", origin=None) as socket:
        for number in range(5):
            await socket.send(bytes([number] * 20))
        while world[0]._bus.bad_frames < 5:  # noqa: ASYNC110 - the world says what it counts only once
            await asyncio.sleep(0.01)
    said = [world[1].said.get_nowait() for _ in range(world[1].said.qsize())]
    assert sum("is no frame of Jacdac" in words for words in said) == 1


async def test_a_port_that_is_taken_is_said(world: tuple[JacdacWorld, Host]) -> None:
    with pytest.raises(LinkDown, match=f"page:{world[0].port}: .*in use"):
        await open_world(BridgeLink(f"page:{world[0].port}")).run(Host())


@pytest.mark.parametrize("address", ["usb", "page:", "page:70000", "page:x"])
def test_an_address_that_makes_no_sense_is_refused(address: str) -> None:
    with pytest.raises(ConfigError, match=r"write page:PORT .* or ws://127"):
        open_world(BridgeLink(address))
