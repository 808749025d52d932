"""Installs a release from its files alone, as somebody who has no clone, and runs a robot with it.

Each Python from 3.11 to 3.13 that is found here tries it twice: with what the package index has now, and from a folder
of wheels with no network.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tools.release.building import DISTRIBUTIONS, ReleaseError
from tools.sources import ROOT

VERSIONS = ("3.11", "3.12", "3.13")
PATIENCE_S = 300.0
"""How long a page may take to come up, before the trial has failed."""
EXTRA = "demo"
"""What the README leads to: requirements/run.txt names what it needs."""


def pythons() -> dict[str, Path]:
    """The Pythons of this computer by version: on PATH, else those of pyenv and uv."""
    found = {}
    for version in VERSIONS:
        folders = (os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv", Path.home() / ".local/share/uv/python")
        places = [Path(name) for name in (shutil.which(f"python{version}"),) if name]
        places += sorted(Path(folders[0]).glob(f"versions/{version}.*/bin/python3"))
        places += sorted(Path(folders[1]).glob(f"cpython-{version}.*/bin/python3"))
        for place in places:
            if _answers(place, version):
                found[version] = place
                break
    return found


def _answers(python: Path, version: str) -> bool:
    """Whether it is that version and can make environments (a shim of pyenv may lead to none)."""
    ask = "import ensurepip, sys; print('.'.join(map(str, sys.version_info[:2])))"
    done = subprocess.run([python, "-c", ask], capture_output=True, text=True, check=False)
    return done.returncode == 0 and done.stdout.strip() == version


def wheelhouse(python: Path, release: Path, into: Path) -> Path:
    """Collect the wheels that a computer without network needs: the release's, and tested versions of others."""
    into.mkdir(parents=True)
    for wheel in release.glob("*.whl"):
        shutil.copy(wheel, into)
    hashed = ROOT / "requirements" / "run.txt"
    _pip(python, "download", "--only-binary", ":all:", "--no-deps", "--require-hashes", "-r", hashed, "-d", into)
    return into


def try_it(python: Path, release: Path, version: str, commit: str, *, wheels: Path | None) -> str:
    """Install into a new environment, ask for the version, start a robot, open its page; returns what was seen.

    Args:
        python: what makes the environment.
        release: the folder of the release.
        version: what `msbot --version` has to say.
        commit: and the build.
        wheels: a folder with all wheels, for a computer without network.

    Raises:
        ReleaseError: it cannot be installed, or there is no page.
    """
    with tempfile.TemporaryDirectory() as scratch:
        begun = time.monotonic()
        bin_folder = install(python, release, version, Path(scratch, "env"), wheels=wheels)
        installed = time.monotonic()
        said = _run(bin_folder / "msbot", "--version", cwd=scratch).strip()
        if said != (wanted := f"msbot {version} (build {commit[:12]})"):
            raise ReleaseError(f"msbot --version says {said!r} in place of {wanted!r}")
        _run(bin_folder / "python", "-m", "pip", "check", cwd=scratch)
        with page(bin_folder, Path(scratch)) as (address, parts):
            up = time.monotonic()
        return f"installed in {installed - begun:.0f} s, {parts} parts and {address} {up - installed:.0f} s later"


def install(python: Path, release: Path, version: str, into: Path, *, wheels: Path | None) -> Path:
    """Make an environment with the release in it; returns its folder of programs."""
    _run(python, "-m", "venv", into, cwd=release)
    folder = into / "bin"
    if wheels is not None:
        _pip(folder / "python", "install", "--no-index", "--find-links", wheels, f"msbot[{EXTRA}]=={version}")
    else:
        own = [f"{name} @ {_wheel(release, name).absolute().as_uri()}" for name in DISTRIBUTIONS if name != "msbot"]
        _pip(folder / "python", "install", f"msbot[{EXTRA}] @ {_wheel(release, 'msbot').absolute().as_uri()}", *own)
    return folder


@contextmanager
def page(bin_folder: Path, folder: Path) -> Iterator[tuple[str, int]]:
    """Run `msbot demo`; yields where its page is, and how many parts the page's robot has."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("MSBOT_", "PYTHON"))}
    environment |= {"HOME": str(folder), "MSBOT_STOP_GROUP": "release-trial", "PYTHONUNBUFFERED": "1"}
    log = folder / "demo.log"
    with log.open("wb") as output:
        command = [str(bin_folder / "msbot"), "demo", "--port", "0", "--db", str(folder / "robot.db")]
        running = subprocess.Popen(command, cwd=folder, env=environment, stdout=output, stderr=subprocess.STDOUT)
        try:
            yield _wait_for_page(running, log)
        finally:
            running.terminate()
            running.wait()


def _wait_for_page(running: subprocess.Popen[bytes], log: Path) -> tuple[str, int]:
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end and running.poll() is None:
        for word in log.read_text("utf-8", "replace").split():
            if word.startswith("http://127.0.0.1:"):
                address = "/".join(word.split("/")[:3])
                if (parts := _parts(address, word)) is not None:
                    return address, parts
        time.sleep(0.2)
    raise ReleaseError(f"the demo has no page; it said:\n{log.read_text('utf-8', 'replace')}")


def _parts(address: str, link: str) -> int | None:
    """How many parts work in the robot, asked as a browser does; None: the page is not up, or a slot is empty yet."""
    opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
    try:
        with opener.open(link, timeout=30) as answer:
            if "MsBOT" not in answer.read().decode():
                raise ReleaseError(f"{link} is no page of MsBOT")
        with opener.open(f"{address}/api/status", timeout=30) as answer:
            told = json.load(answer)
    except (urllib.error.URLError, ConnectionError):
        return None
    return int(told["active"]) if told["active"] == told["slots"] else None


def _wheel(release: Path, name: str) -> Path:
    (wheel,) = release.glob(f"{name.replace('-', '_')}-*.whl")
    return wheel


def _pip(python: Path, *words: object) -> None:
    _run(python, "-m", "pip", "--disable-pip-version-check", "--quiet", *words, cwd=ROOT / "build")


def _run(*words: object, cwd: Path | str) -> str:
    command = [str(word) for word in words]
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise ReleaseError(f"`{' '.join(command)}` failed:\n{done.stdout}{done.stderr}")
    return done.stdout
