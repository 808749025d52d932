"""Man pages: one for each command, which `man` shows without a warning; the wheels have them."""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from msbot_agent.cli import COMMANDS
from tests import ROOT
from tools.man_pages import main

PACKAGES = ("msbot-agent", "msbot", "msbot-school", "msbot-bridges", "msbot-web")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("man")
    main(str(made))
    return made


def test_each_command_has_one(folder: Path) -> None:
    assert {page.stem for page in folder.iterdir()} == {"msbot", *(f"msbot-{name}" for name in COMMANDS)}
    text = (folder / "msbot-topic.1").read_text("utf-8")
    assert r"\fBmsbot topic pub\fR [OPTIONS] TOPIC [TYPE] VALUE..." in text
    assert r"\fB\-\-once\fR" in text


@pytest.mark.skipif(shutil.which("man") is None or shutil.which("groff") is None, reason="needs man and groff")
def test_man_shows_them_without_a_warning(folder: Path) -> None:
    pages = sorted(map(str, folder.iterdir()))
    done = subprocess.run(["groff", "-man", "-Tutf8", "-ww", *pages], capture_output=True, check=False)
    assert (done.returncode, done.stderr.decode()) == (0, "")
    shown = subprocess.run(
        ["man", "-l", str(folder / "msbot-topic.1")],
        capture_output=True,
        text=True,
        check=True,
        env={"MANWIDTH": "100"},
    )
    assert "msbot topic echo" in shown.stdout
    assert shown.stderr == ""


def test_an_option_is_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for option, status in (("--help", 0), ("--folder", 2)):
        with pytest.raises(SystemExit) as ended:
            main(option)
        assert ended.value.code == status
    assert list(tmp_path.iterdir()) == []


def test_a_wheel_brings_those_of_its_commands(folder: Path, tmp_path: Path) -> None:
    project = tmp_path / "msbot-bridges"
    shutil.copytree(ROOT / "packages" / "msbot-bridges", project, ignore=shutil.ignore_patterns("tests", "build"))
    (project / "build" / "man").mkdir(parents=True)
    shutil.copy(folder / "msbot-bridge.1", project / "build" / "man")
    command = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(tmp_path / "dist")]
    subprocess.run(command, cwd=project, check=True, capture_output=True)
    (wheel,) = (tmp_path / "dist").iterdir()
    names = zipfile.ZipFile(wheel).namelist()
    assert [name for name in names if name.endswith(".1")] == [
        "msbot_bridges-0.1.0.data/data/share/man/man1/msbot-bridge.1"
    ]


def test_the_hooks_are_copies() -> None:
    assert len({(ROOT / "packages" / name / "hatch_build.py").read_text() for name in PACKAGES}) == 1
