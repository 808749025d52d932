"""When a page tries to get its connection back (`static/reconnect.js`), in Node.js, in virtual time."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

NODE = shutil.which("node")
NEEDED = "MSBOT_NEED_NODE"
SCRIPT = Path(str(files("msbot_web") / "static" / "reconnect.js"))
WORLD = """
const fs = require("fs");
eval(fs.readFileSync(process.argv[1], "utf8"));
let seed = 7;
const chance = () => (seed = (seed * 48271) % 2147483647) / 2147483647;
// A page that is looked at every 200 ms of virtual time. `robot(page, step, now)` says what becomes of a step.
function live(ms, page, answers, robot) {
  const steps = [];
  for (let now = 0; now < ms; now += 200) {
    const step = page.step(now, answers(now));
    if (step) steps.push([step, now]);
    if (step) robot(page, step, now);
  }
  return steps;
}
"""


def play(scene: str) -> Any:
    """What a scene in JavaScript gives."""
    if NODE is None:
        (pytest.fail if os.environ.get(NEEDED) else pytest.skip)("no Node.js on this machine: apt-get install nodejs")
    code = f"{WORLD}\nconsole.log(JSON.stringify((() => {{ {scene} }})()));"
    done = subprocess.run([NODE, "-e", code, str(SCRIPT)], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_waits_grow_and_no_dead_robot_is_asked_for_a_connection() -> None:
    steps = play(
        """const page = new MsbotReconnect(chance);
        page.connected(); page.lost(0);
        return live(120000, page, (now) => now > 30000, (page, step, now) => page.lost(now));"""
    )
    assert {step for step, _ in steps} == {"connect"}
    times = [at for _, at in steps]
    assert times[0] > 30_000, "nothing is asked of a robot that does not answer"
    gaps = [late - early for early, late in pairwise(times)]
    assert gaps[0] <= 1000
    assert 4000 <= min(gaps[-5:]) <= max(gaps[-5:]) <= 12_200
    assert len(times) < 25


def test_a_class_comes_back_spread_and_each_page_is_loaded_once() -> None:
    found = play(
        """const pages = [...Array(60).keys()].map(() => new MsbotReconnect(chance));
        return pages.map((page) => {
          page.connected(); page.lost(0);
          let before = false;
          const answers = (now) => {
            if (now > 5000 && !before) page.back(now);
            return (before = now > 5000);
          };
          return live(20000, page, answers, (page, step, now) => {
            if (step === "connect") page.gone(now, false);
            else if (step === "turn") page.turn(now, 1000);
          });
        });"""
    )
    assert all([step for step, _ in steps[:3]] == ["connect", "turn", "reload"] for steps in found)
    connects = sorted(steps[0][1] for steps in found)
    assert 5000 < connects[0] <= connects[-1] <= 6200
    assert len({at for at in connects}) > 3, "not all in one moment"
    assert all(sum(step == "reload" for step, _ in steps) == 1 for steps in found)


def test_who_is_refused_a_turn_asks_less_and_less_often_and_another_tab_is_no_failure() -> None:
    refused, waited, stuck = play(
        """const anew = () => { const page = new MsbotReconnect(chance); page.gone(0, true); return page; };
        return [live(60000, anew(), () => true, (page, step, now) => page.refused(now)).length,
                live(60000, anew(), () => true, (page, step, now) => page.later(now)).length,
                live(60000, anew(), () => true, (page, step, now) => step === "turn" && page.turn(now, 0))];"""
    )
    assert 6 <= refused <= 20
    assert 50 <= waited <= 150
    reloads = [at for step, at in stuck if step == "reload"]
    assert reloads[0] >= 1400, "a hidden tab lets the others go first"
    assert all(late - early >= 15_000 for early, late in pairwise(reloads)), "no storm"
