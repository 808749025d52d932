"""The six distributions: their pages, their versions, and how they need each other."""

from __future__ import annotations

import importlib
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from msbot_agent.cli import package_of
from msbot_agent.process.user_folders import PACKAGES as NAMES
from msbot_agent.startup.extensions import OWN_PACKAGES
from tools.sources import PACKAGES, ROOT, dotted

PROJECTS = {
    package.parents[1].name: tomllib.loads((package.parents[1] / "pyproject.toml").read_text("utf-8"))["project"]
    for package in PACKAGES
}


def test_all_know_of_the_same_six() -> None:
    assert tuple(PROJECTS) == OWN_PACKAGES
    assert tuple(package.name for package in PACKAGES) == NAMES
    assert {path.parent.name for path in ROOT.glob("packages/*/pyproject.toml")} == set(PROJECTS)


def test_versions_go_in_lockstep() -> None:
    (version,) = {project["version"] for project in PROJECTS.values()}
    needed = [
        wanted
        for project in PROJECTS.values()
        for wanted in project["dependencies"]
        if re.split(r"[\[=]", wanted)[0] in PROJECTS
    ]
    assert len(needed) == len(PROJECTS) - 1
    assert all(wanted.endswith(f"=={version}") for wanted in needed), needed


def test_each_needs_the_one_below_and_nobody_above() -> None:
    order = [name for name in PROJECTS if name != "msbot-bridges"]
    below = {name: order[place - 1 : place] for place, name in enumerate(order)}
    below["msbot-bridges"] = ["msbot"]  # beside msbot-school
    for name, project in PROJECTS.items():
        own = [re.split(r"[\[=]", wanted)[0] for wanted in project["dependencies"]]
        assert [wanted for wanted in own if wanted in PROJECTS] == below[name]


def test_the_protocol_needs_nothing_of_others() -> None:
    assert PROJECTS["msbot-xrce"]["dependencies"] == []


@pytest.mark.parametrize("name", PROJECTS)
def test_what_its_page_shows_runs(name: str, tmp_path: Path) -> None:
    page = (ROOT / "packages" / name / "README.md").read_text("utf-8")
    assert page.startswith(f"# {name}\n")
    for program in re.findall(r"```python\n(.*?)```", page, re.DOTALL):
        file = tmp_path / "program.py"
        file.write_text(program.replace("part.run()", ""), "utf-8")
        run = subprocess.run([sys.executable, file], capture_output=True, text=True, check=False)
        assert "Traceback" not in run.stderr, run.stderr


def test_an_import_loads_what_it_uses_and_no_more() -> None:
    script = "import sys, {}; print(*(name for name in sys.modules if name.startswith('msbot')))"

    def loaded(module: str) -> set[str]:
        command = [sys.executable, "-c", script.format(module)]
        return set(subprocess.run(command, capture_output=True, text=True, check=True).stdout.split())

    frames = loaded("msbot_agent.link.can.protocol.frames")
    assert len(frames) < 20
    assert not [name for name in frames if ".net" in name or ".serial" in name]
    assert len(loaded("msbot_agent")) < 10


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.name)
def test_no_name_of_a_lazy_package_is_that_of_a_module_in_it(package: Path) -> None:
    """An import of the module would put it in the place of the name."""
    wrong = []
    for path in package.rglob("__init__.py"):
        names = vars(importlib.import_module(dotted(path))).get("_NAMES", {})
        shown = {name for found in names.values() for name in found}
        wrong += [f"{dotted(path)}.{other.stem}" for other in path.parent.iterdir() if other.stem in shown]
    assert wrong == []


def test_the_package_that_a_command_is_said_to_be_in_brings_it() -> None:
    for name, project in PROJECTS.items():
        points = project.get("entry-points", {}).get("msbot.commands", {})
        assert {command: package_of(command) for command in points} == dict.fromkeys(points, name)
