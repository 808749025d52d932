"""The page Plots in a real browser: live, the past, the keyboard, views and tables."""

from __future__ import annotations

import csv
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from tests.e2e.processes import running
from tests.web.browser.conftest import Site, go

THREE_PICTURES_MS = """async () => {
  const three = () => new Promise((done) => {
    const before = msbotPlotsFrames();
    const look = () => msbotPlotsFrames() > before + 3 ? done(performance.now()) : setTimeout(look, 5);
    look();
  });
  const began = await three();
  return await three() - began;
}"""
FRAMES = "window.msbotPlotsFrames ? msbotPlotsFrames() : 0"
SHOWN = "/plots?show=ear.level,@bus&span=10"
INK_AT = """([at, value]) => {
    // Whether a coloured line goes through a place of the chart, of 10 s and of values from 0 to 9 with some room.
    const canvas = document.querySelector(".plot-charts canvas"), over = document.querySelector(".plot-charts .u-over");
    const ratio = canvas.width / canvas.offsetWidth, [least, most] = uPlot.rangeNum(0, 9, 0.1, true);
    const x = over.offsetLeft + over.offsetWidth * (at - 10000) / 10000;
    const y = over.offsetTop + over.offsetHeight * (most - value) / (most - least);
    const { data } = canvas.getContext("2d").getImageData(Math.round(x * ratio) - 2, Math.round(y * ratio) - 2, 5, 5);
    for (let i = 0; i < data.length; i += 4) {
        const [red, green, blue] = data.slice(i, i + 3);
        if (data[i + 3] > 128 && Math.max(red, green, blue) - Math.min(red, green, blue) > 90) return true;
    }
    return false;
}"""


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """The rover with its recorder, which other tests do without."""
    folder = tmp_path_factory.mktemp("demo")
    with running("demo", "--robot", "rover", "--rec", "10min", "--port", "0", cwd=folder) as process:
        yield Site(process)


def test_curves_live_held_and_back_by_keyboard_with_their_figures(blank: Page, demo: Site, tmp_path: Path) -> None:
    page = blank
    go(page, demo.base + SHOWN)
    row, bus = (page.locator("#ms-plot-figures tr", has_text=curve) for curve in ("ear.level.percent", "@bus"))
    for curve in (row, bus):
        expect(curve.locator("td.at")).not_to_have_text("–")
    page.wait_for_function(f"{FRAMES} > 2")
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
    page.wait_for_function(f"{FRAMES} > {drawn + 2}")
    assert page.evaluate(THREE_PICTURES_MS) > 1000, "who wants no motion sees at most two pictures a second"
    remove = page.get_by_role("button", name="Remove ear.level.percent")
    page.get_by_role("button", name="A second earlier").focus()
    for _ in range(5):
        page.keyboard.press("Tab")
        if remove.evaluate("(one) => one === document.activeElement"):
            break
    expect(remove).to_be_focused()
    page.keyboard.press("Enter")
    expect(row).to_have_count(0)


def test_the_recorder_s_time_is_shown_a_view_is_kept_and_a_picture_saved(blank: Page, demo: Site) -> None:
    page = blank
    go(page, demo.base + SHOWN)
    page.wait_for_function(f"{FRAMES} > 3")
    page.get_by_text("10 min", exact=True).click()
    expect(page.get_by_role("status").filter(has_text=" to ")).to_be_visible()
    row = page.locator("#ms-plot-figures tr", has_text="ear.level.percent")
    expect(row.locator("td").nth(1)).not_to_have_text("–")
    page.get_by_label("Name of this view").fill("noise")
    page.get_by_role("button", name="Save").click()
    page.wait_for_function("(JSON.parse(localStorage.msbot_plots_views || '{}').noise || '').includes('span=600')")
    go(page, f"{demo.base}/plots?show=nobody,ear.level&span=10")
    expect(page.get_by_text("Not measured so far: nobody")).to_be_visible()
    page.wait_for_function("location.search.includes('nobody')")  # a page that is made anew waits for it, too
    go(page, f"{demo.base}/plots?show=ear.level,ear:threshold,@late,@beat.ear&span=10")
    page.wait_for_function(f"{FRAMES} > 3")
    assert page.locator(".plot-charts canvas").count() == 3, "three units, three charts"
    with page.expect_download() as download:
        page.get_by_role("button", name="Picture (PNG)").click()
    width, height = struct.unpack(">II", Path(download.value.path()).read_bytes()[16:24])
    across, down = page.evaluate(
        "[...'WH'].map((one) => document.querySelector('.plot-charts')[one === 'W' ? 'clientWidth' : 'clientHeight'])"
    )
    assert width == 2 * across
    assert height > 2 * down, "the names of the curves are below"


def test_a_held_picture_follows_the_window_s_size_and_colours_and_shows_gaps_and_steps(blank: Page, demo: Site) -> None:
    page = blank
    go(page, demo.base + SHOWN)
    page.wait_for_function(f"{FRAMES} > 3")
    # What a robot rarely has: a value that is no number, and a setting that was changed.
    page.evaluate("""() => msbotPlots.show({
        host: "", now: 20000, live: false, span: 10000, from: 10000, to: 20000, address: location.href, words: {},
        curves: [{ name: "gap", unit: "m", holds: false,
                   points: [[11000, 0], [14000, 0], [15000, NaN], [16000, 0], [19000, 0]] },
                 { name: "set", unit: "m", holds: true, points: [[9000, 1], [15000, 9]] }] })""")
    assert page.evaluate(INK_AT, [13000, 0]), "a line from point to point"
    assert not page.evaluate(INK_AT, [15000, 0]), "nothing is drawn where there was no number"
    assert page.evaluate(INK_AT, [12000, 1]), "a setting holds until it is changed"
    assert page.evaluate(INK_AT, [18000, 9]), "the last one until now"
    assert not page.evaluate(INK_AT, [12000, 5])
    page.set_viewport_size({"width": 420, "height": 800})
    page.wait_for_function("document.querySelector('.plot-charts canvas').offsetWidth < 420")
    drawn = page.evaluate(FRAMES)
    page.evaluate("document.body.classList.toggle('body--dark')")
    page.wait_for_function(f"{FRAMES} > {drawn}")
