"""What every test shares: hypothesis without wall-clock deadlines (the machine may be busy), its own STOP, that no
event loop waits for a database, and the order of the whole suite."""

import gc
import logging
import os
import shutil
import signal
import tempfile
from collections.abc import Generator, Iterator
from functools import cache
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from msbot.stop.socket_names import GROUP_VARIABLE
from msbot_agent.startup.bytecode_cache import without_garbage_collection
from tests import few_reports, import_order, place_of, taking_turns, time_of_a_test
from tests.effort import THOROUGH
from tests.loop_guard import guard
from tests.stock.tap import Tap, tapped

# The robots that tests start record nothing, unless a test wants it: the recordings belong to the user's own robots.
os.environ["MSBOT_REC"] = "off"

# Tests run beside each other: a STOP of one must not reach the robots of another.
os.environ[GROUP_VARIABLE] = f"test{os.getpid()}"

# A suite that runs in the background of a script, or by `nohup`, has these ignored, and so would all that it starts.
for number, usual in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, usual)

settings.register_profile("msbot", deadline=None, max_examples=50, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("thorough", settings.get_profile("msbot"), max_examples=2000)
settings.load_profile("thorough" if THOROUGH else "msbot")

guard()


SCRATCH = pytest.StashKey[str]()


def pytest_configure(config: pytest.Config) -> None:
    """Workers share the work of importing, and take turns with browsers; no alarm ends the whole run."""
    config.pluginmanager.register(import_order)
    config.pluginmanager.register(time_of_a_test)
    config.pluginmanager.register(few_reports)
    if (worker := getattr(config, "workerinput", None)) is not None:
        # Robots find each other in this folder: those of one worker's tests are not in sight of another's.
        own = Path(tempfile.gettempdir()) / worker["workerid"]
        own.mkdir(exist_ok=True)
        os.environ["TMPDIR"] = str(own)
        tempfile.tempdir = None
        return
    if config.pluginmanager.hasplugin("xdist"):
        config.pluginmanager.register(taking_turns)
    # One folder for what this run's processes leave behind; many are killed, and cannot clear up. It also keeps the
    # robots that run on this machine out of the tests' sight. What tests write themselves (`tmp_path`) stays.
    os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", tempfile.gettempdir())
    config.stash[SCRATCH] = os.environ["TMPDIR"] = tempfile.mkdtemp(prefix="msbot-tests-")
    tempfile.tempdir = None  # so that it is looked for anew


def pytest_unconfigure(config: pytest.Config) -> None:
    """Clear up; a process that was killed a moment ago may still be writing, and its file may stay."""
    if scratch := config.stash.get(SCRATCH, ""):
        shutil.rmtree(scratch, ignore_errors=True)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """Of `-n auto`."""
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return processors + taking_turns.MORE_WORKERS


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_collection() -> Generator[None, object, object]:
    """No garbage is looked for among ten thousand tests and all of MsBOT, neither now nor while they run.

    Tests make a thousand objects in no time, and there is room for more until they are looked through: a twentieth of
    what only computes went into that.
    """
    with without_garbage_collection():
        found = yield
    gc.set_threshold(10_000)
    return found


LOGGERS = ("", "msbot", "msbot.part")
"""Those whose levels commands change; the first is the root."""


@pytest.fixture(autouse=True)
def _levels_of_loggers() -> Iterator[None]:
    """A test that runs a command with `-v` must not make the others' logs longer."""
    before = [logging.getLogger(name).level for name in LOGGERS]
    yield
    for name, level in zip(LOGGERS, before, strict=True):
        if (logger := logging.getLogger(name)).level != level:  # setting it has all loggers look anew
            logger.setLevel(level)


PAGES = (
    "blocks", "truth", "arena", "tab", "demo_pages", "time_slider", "wires_by_hand", "plots", "lessons_by_hand",
    "program_page", "german", "french", "class_room", "board_page", "hostile_names", "strangers_files",
    "describing_parts", "class_view", "held_controls", "menus", "everybody", "hand_ins_by_hand", "gallery",
    "pupils_page", "learn_and_missions_by_hand", "come_back", "behind_proxy", "behind_filters", "class_of_three",
)  # fmt: skip
"""Two browsers at a time: in this order there is mostly one that works hard beside one that waits."""
FIRST = (
    *(f"web/browser/test_{name}.py" for name in PAGES), "web/browser", "web/api/test_routes.py",
    "lessons/test_shipped_lessons.py", "part/test_faults.py", "e2e", "hostile",
    "operations/test_running_operations.py", "firmware", "lab", "web/test_records.py", "registry/test_kill.py",
    "test_fuzz.py", "space/zenoh", "space/dds", "wide", "hardware/test_keeper.py", "part/test_beginner_hints.py",
    "cli/board", "homes/test_conformance.py", "test_platforms.py", "cli/change/test_robot_access.py",
    "school/test_mdns.py", "runtime/test_worker.py", "runtime/test_kept_worker.py",
)  # fmt: skip
"""What takes longest begins first, so that at the end no worker waits for another one."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Sort the files by that; each stays whole. Where a test tries much, no time is too long for it."""
    if THOROUGH:
        for item in items:
            item.add_marker(pytest.mark.timeout(0), append=False)
    ranks = [Path(name) for name in FIRST]

    @cache
    def rank(file: Path) -> int:
        return next(
            (number for number, path in enumerate(ranks) if (place_of(file) or file).is_relative_to(path)), len(ranks)
        )

    items.sort(key=lambda item: rank(item.path))


@pytest.fixture(scope="session")
def _stock_tap() -> Iterator[Tap]:
    """One for the whole run of a worker."""
    with tapped() as tap:
        yield tap


@pytest.fixture(autouse=True)
def _what_stock_clients_hear(_stock_tap: Tap) -> Iterator[None]:
    """What the agents of a test send to stock clients is what these can read."""
    _stock_tap.take()
    yield
    found = _stock_tap.take()
    assert not found, "\n".join(["not for stock clients:", *found[:10]])
