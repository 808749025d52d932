"""Workers of one run import the test modules from different places on, so that each is compiled by one of them only.

pytest compiles a test module with its assertions taken apart, once, and keeps the result beside it. Workers that begin
together, and go the same way, all compile each module at the same time: in a new clone that is 25 s of processor time
for each worker. So before it collects, each begins at a place of its own and goes around; what another one has compiled
meanwhile is only read.
"""

from __future__ import annotations

import importlib
from contextlib import suppress
from pathlib import Path

import pytest

from tests import place_of


@pytest.hookimpl(tryfirst=True)
def pytest_collection(session: pytest.Session) -> None:
    """Import what this worker will collect; collecting itself then finds all of it loaded."""
    worker = getattr(session.config, "workerinput", None)
    if worker is None:
        return
    places = [Path(argument.partition("::")[0]) for argument in session.config.args]
    number = int(worker["workerid"].removeprefix("gw"))
    for name in begun_at(
        number, worker["workercount"], sorted({name for place in places for name in modules_in(place)})
    ):
        with suppress(
            Exception, pytest.skip.Exception, pytest.fail.Exception
        ):  # collecting meets it again, and says it
            importlib.import_module(name)


def begun_at(worker: int, workers: int, modules: list[str]) -> list[str]:
    """All of them, from this worker's place on."""
    here = worker * len(modules) // workers
    return modules[here:] + modules[:here]


def modules_in(place: Path) -> list[str]:
    """The names of the test modules in a folder; of the module if it is one."""
    files = [file.resolve() for file in (place.rglob("test_*.py") if place.is_dir() else [place])]
    inside = [found for file in files if file.suffix == ".py" and (found := place_of(file)) is not None]
    return [".".join(("tests", *found.with_suffix("").parts)) for found in inside]
