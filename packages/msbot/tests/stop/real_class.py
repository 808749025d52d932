"""STOP of a class of two real robots: by its page in a real browser, and while one blueprint goes to both, and back."""

from __future__ import annotations

import asyncio
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from threading import Thread
from unittest import mock

from msbot.config import Blueprint, Library, load_blueprint, load_library
from msbot_school.classroom.class_robots import ClassRobot, class_robots, far_robots
from msbot_school.classroom.remote_access import RemoteAccess
from msbot_school.classroom.remote_masters import ParallelRequest, read_status
from msbot_school.classroom.rollout import RollOut, plan_for, undo_job
from msbot_school.classroom.rollout_run import RollOutLog, RollOutRun, StepState
from msbot_web.access.passwords import Argon2Hasher
from tests.hostile.robot import PATIENCE_S, TOKEN, until
from tests.stop.oracle import Verdict
from tests.stop.real_robots import RealRobot, Trial

PASSWORD = "a password of the tests"
BEFORE, AFTER = "HelloWorldTopic_1_to_2", "AnotherTopic"
"""The wire between the two parts: the blueprint for all gives it another topic, so that both get new settings."""


async def _hash_of(password: str) -> str:
    hasher = Argon2Hasher()
    try:
        return await hasher.hash(password, asker="test")
    finally:
        hasher.close()


class RealClass:
    """Two robots: the first has a page and is reached by its API, as if it were elsewhere; the second by its socket."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self.robots: list[RealRobot] = []
        for number in (1, 2):
            (folder / f"robot{number}").mkdir()
            robot = RealRobot(folder / f"robot{number}", stack)
            blueprint = robot.folder / "robot.toml"
            blueprint.write_text(blueprint.read_text().replace("X100Y100Z100", f"X{number}"))
            robot.env = {**robot.env, **(self.robots[0].env if self.robots else {})}  # one user
            self.robots.append(robot)
        first, second = self.robots
        first.begin(password_hash=asyncio.run(_hash_of(PASSWORD)))
        second.master()
        second.begin_parts(second.link)
        self._library: Library = load_library()
        self._folder = folder
        self._book = RollOutLog(folder)

    def say_stop(self) -> None:
        """To each robot by its own way."""
        for robot in self.robots:
            robot.tell("stop")

    @contextmanager
    def class_page(self, chromium: str) -> Iterator[Callable[[], None]]:
        """The class page in a browser; gives what presses its STOP."""
        from playwright.sync_api import sync_playwright  # the other deeds need none

        first = self.robots[0]
        site = first.page.removesuffix("/api")
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-gpu"])
            page = browser.new_page()
            page.set_default_timeout(PATIENCE_S * 1000)
            signed_in = page.request.post(
                f"{site}/login", form={"name": "ann", "password": PASSWORD}, headers={"origin": site}
            )
            assert signed_in.ok, signed_in.text()
            page.goto(f"{site}/class")
            page.locator("a.slot, div.slot").nth(1).wait_for()
            yield page.get_by_role("button", name=re.compile("^STOP .* of the class$")).click
            browser.close()

    def wanted(self) -> Blueprint:
        """The blueprint for all."""
        file = self._folder / "all.toml"
        text = (self.robots[0].folder / "robot.toml").read_text()
        assert BEFORE in text
        file.write_text(text.replace(BEFORE, AFTER))
        return load_blueprint(file, self._library)

    def roll_out(self) -> RollOutRun:
        """The blueprint for all, not begun yet."""
        roll_out = RollOut("all.toml", self._folder, self._library, (), "ann", book=self._book)
        with mock.patch.dict(os.environ, self.robots[0].env):
            plans = [plan_for(robot, self.wanted()) for robot in self._members()]
            assert all(plan.changes for plan in plans), plans
            return RollOutRun("all.toml", [roll_out.job(plan) for plan in plans])

    def undo(self) -> RollOutRun:
        """The way back, not begun yet."""
        last = self._book.last()
        assert last is not None
        with mock.patch.dict(os.environ, self.robots[0].env):
            members = self._members()
            jobs = [undo_job(last.at, one, members, "ann", self._book) for one in last.done]
        return RollOutRun("all.toml", jobs, is_undo=True)

    def _members(self) -> Sequence[ClassRobot]:
        """Both, as soon as they answer: a look has an end, and on a busy machine the first one may be too short."""
        found: list[ClassRobot] = []

        def look() -> bool:
            access = RemoteAccess(self.robots[0].page.removesuffix("/api"), TOKEN, "MSBOT_MASTER", "X1")
            far = far_robots([access], ParallelRequest([access], read_status, PATIENCE_S))
            here = (one for one in class_robots(None, ()) if one.serial_number == "X2")
            found[:] = [*far, *here]
            return len(found) == 2 and all(one.answers for one in found)

        until(look)
        return found


def do(run: RollOutRun) -> None:
    """All of it."""
    for number in range(len(run.steps)):
        run.do(number)
    assert [step.state for step in run.steps] == [StepState.CHANGED] * 2, run.steps


def rolled_out(robots: RealClass) -> Verdict:
    """STOP, a roll-out to both robots, and its undo"""
    trial = Trial(*robots.robots)
    robots.say_stop()
    trial.all_confirm()
    do(robots.roll_out())
    trial.until_confirmed()
    do(robots.undo())
    trial.until_confirmed()
    return trial.go()


def under_way(robots: RealClass) -> Verdict:
    """STOP while a roll-out goes to both robots; and its undo"""
    trial, run = Trial(*robots.robots), robots.roll_out()
    working = Thread(target=do, args=(run,))
    working.start()
    robots.say_stop()
    trial.all_confirm()
    working.join()
    trial.until_confirmed()
    do(robots.undo())
    trial.until_confirmed()
    return trial.go()


def undo_under_way(robots: RealClass) -> Verdict:
    """a roll-out to both robots; STOP while it is taken back"""
    do(robots.roll_out())
    trial, run = Trial(*robots.robots), robots.undo()
    working = Thread(target=do, args=(run,))
    working.start()
    robots.say_stop()
    trial.all_confirm()
    working.join()
    trial.until_confirmed()
    return trial.go()


def by_class_page(robots: RealClass, chromium: str) -> Verdict:
    """STOP for all robots on the class page"""
    with robots.class_page(chromium) as press:
        trial = Trial(*robots.robots)
        press()
        trial.all_confirm()
        return trial.go()


DEEDS: tuple[Callable[[RealClass], Verdict], ...] = (rolled_out, under_way, undo_under_way)


@contextmanager
def real_class(folder: Path) -> Iterator[RealClass]:
    """Two robots at work."""
    with ExitStack() as stack:
        yield RealClass(folder, stack)


def class_stories(folder: Path, chromium: str | None) -> Mapping[str, Verdict]:
    """One class, and one deed after the other; the page only where there is a browser."""
    with real_class(folder) as robots:
        verdicts = {deed.__doc__ or "": deed(robots) for deed in DEEDS}
        if chromium is not None:
            verdicts[by_class_page.__doc__ or ""] = by_class_page(robots, chromium)
        return verdicts
