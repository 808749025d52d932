"""The page Plots in a real browser: live, the past, the keyboard, views and tables."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from tests.e2e.processes import running
from tests.web.browser.conftest import Site, go

FRAMES = "window.msbotPlotsFrames ? msbotPlotsFrames() : 0"
SHOWN = "/plots?show=ear.level,@bus&span=10"


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """The rover with its recorder, which other tests do without."""
    folder = tmp_path_factory.mktemp("demo")
    with running("demo", "--robot", "rover", "--rec", "10min", "--port", "0", cwd=folder) as process:
        yield Site(process)


def test_curves_live_held_and_back_by_keyboard_with_their_figures(page: Page, demo: Site, tmp_path: Path) -> None:
    go(page, demo.base + SHOWN)
    row = page.locator("#ms-plot-figures tr", has_text="ear.level.percent")
    expect(row.locator("td.at")).not_to_have_text("–")
    page.wait_for_function(f"{FRAMES} > 10")
    area = page.locator(".plot-area")
    area.focus()
    page.keyboard.press("Space")
    expect(page.get_by_role("status").filter(has_text=" to ")).to_be_visible()
    drawn = page.evaluate(FRAMES)
    page.keyboard.press("ArrowLeft")
    expect(page.locator("#ms-plot-figures th.at")).not_to_have_text("Latest")
    expect(page.locator(".plot-cursor")).to_be_visible()
    assert page.evaluate(FRAMES) <= drawn + 2, "what is held stands still"
    with page.expect_download() as download:
        page.get_by_role("button", name="Table (CSV)").click()
    download.value.save_as(tmp_path / "plots.csv")
    head, *rows = csv.reader((tmp_path / "plots.csv").read_text().splitlines())
    assert head == ["time", "curve", "value", "unit"]
    assert {(cells[1], cells[3]) for cells in rows} == {("ear.level.percent", "%"), ("@bus", "%")}
    area.focus()
    page.keyboard.press("Home")
    expect(page.get_by_role("status").filter(has_text=" to ")).to_have_count(0)
    page.wait_for_function(f"{FRAMES} > {drawn + 10}")


def test_the_recorder_s_time_is_shown_a_view_is_kept_and_a_picture_saved(page: Page, demo: Site) -> None:
    go(page, demo.base + SHOWN)
    page.wait_for_function(f"{FRAMES} > 3")
    page.get_by_text("10 min", exact=True).click()
    expect(page.get_by_role("status").filter(has_text=" to ")).to_be_visible()
    row = page.locator("#ms-plot-figures tr", has_text="ear.level.percent")
    expect(row.locator("td").nth(1)).not_to_have_text("–")
    page.get_by_label("Name of this view").fill("noise")
    page.get_by_role("button", name="Save").click()
    page.wait_for_function("(JSON.parse(localStorage.msbot_plots_views || '{}').noise || '').includes('span=600')")
    with page.expect_download() as download:
        page.get_by_role("button", name="Picture (PNG)").click()
    assert Path(download.value.path()).read_bytes().startswith(b"\x89PNG")
