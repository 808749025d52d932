"""The set-up of `make demo`: files are installed by their hashes, and a folder may have any name."""

from __future__ import annotations

import hashlib
import os
import shutil
import signal
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tools.set_up import begin_quickly, can_block, install_requirements, point_without_letters


@pytest.mark.skipif(sys.platform == "win32", reason="make sets up Unix only; its folders are laid out otherwise there")
@pytest.mark.parametrize("name", ["_editable_impl_msbot.pth", "_msbot.pth"])
def test_a_folder_with_an_umlaut_is_found_in_the_locale_c_too(tmp_path: Path, name: str) -> None:
    home = tmp_path / "Robo Tür 1"
    (home / "src" / "msbot").mkdir(parents=True)
    (home / "src" / "msbot" / "__init__.py").write_text("here = 'found'\n")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", home / ".venv"], check=True)
    (packages,) = (home / ".venv").glob("lib/python*/site-packages")
    pointer = packages / name
    pointer.write_text(f"{home / 'src'}\n", encoding="utf-8")  # as pip leaves it

    point_without_letters(home / ".venv")

    assert pointer.read_text().isascii()
    started = subprocess.run(
        [home / ".venv" / "bin" / "python", "-c", "import msbot; print(msbot.here)"],
        env={**os.environ, "LC_ALL": "C"},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (started.stdout, started.stderr) == ("found\n", "")


SCRIPTS = {
    "pip before 25": "#!{python}\n# -*- coding: utf-8 -*-\nimport re\nimport sys\nfrom msbot_command import main\n",
    "a path with a blank": "#!/bin/sh\n'''exec' \"{python}\" \"$0\" \"$@\"\n' '''\nimport re\nimport sys\n",
    "pip 25": "#!{python}\nimport sys\nfrom msbot_command import main\n",
}


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has programs in place of these scripts")
@pytest.mark.parametrize("kind", SCRIPTS)
def test_ctrl_c_while_the_command_begins_shows_no_traceback(tmp_path: Path, kind: str) -> None:
    script = tmp_path / "msbot"
    script.write_text(SCRIPTS[kind].format(python=sys.executable))
    script.chmod(0o755)
    begin_quickly(script)
    begin_quickly(script)

    def run(command: str) -> subprocess.CompletedProcess[str]:
        (tmp_path / "msbot_command.py").write_text(command)
        return subprocess.run(
            [script, "7"],
            env={**os.environ, "PYTHONPATH": str(tmp_path)},
            capture_output=True,
            text=True,
            check=False,
        )

    assert run("import sys\ndef main(): print(*sys.argv[1:], 're' in sys.modules)").stdout == "7 False\n"
    broken = run("raise KeyboardInterrupt")
    # Python ends itself by the signal; as long as that is blocked, with the status that shells make of it.
    ended = 128 + signal.SIGINT if can_block() else -signal.SIGINT
    assert (broken.returncode, broken.stderr) == (ended, "")
    assert "ZeroDivisionError" in run("1 / 0").stderr, "a mistake is still told"


@pytest.mark.parametrize("env", ["exit 1", "no such program"])
def test_where_env_cannot_block_a_signal_python_starts_as_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, env: str
) -> None:
    """BusyBox and macOS say that they do not know the option."""
    program = tmp_path / "env"
    if env == "exit 1":
        program.write_text("#!/bin/sh\nexit 1\n")
        program.chmod(0o755)
    monkeypatch.setattr("tools.set_up.BLOCKED", (str(program), "--block-signal=INT"))
    script = tmp_path / "msbot"
    script.write_text("#!/place/of/python\nimport sys\n")
    begin_quickly(script)
    assert script.read_text().startswith("#!/place/of/python\nimport sys\n")


@pytest.mark.skipif(not can_block(), reason="env of this computer starts no program with SIGINT blocked")
@pytest.mark.parametrize("name", ["Kathe's", "Meyer, Anna"])
def test_the_command_starts_in_a_folder_of_any_name(tmp_path: Path, name: str) -> None:
    home = tmp_path / name
    home.mkdir()
    (home / "python").symlink_to(sys.executable)
    script = home / "msbot"
    script.write_text(f"#!/bin/sh\n'''exec' \"{home / 'python'}\" \"$0\" \"$@\"\n' '''\nimport sys\n")
    script.chmod(0o755)
    begin_quickly(script)
    (tmp_path / "msbot_command.py").write_text("import sys\ndef main(): print(*sys.argv[1:])")
    done = subprocess.run(
        [script, "a b", "c"],
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout, done.stderr) == ("a b c\n", "")
    assert "--block-signal=INT" in script.read_text()


def test_there_may_be_no_script(tmp_path: Path) -> None:
    begin_quickly(tmp_path / "msbot")
    (tmp_path / "msbot").write_text("something else")
    begin_quickly(tmp_path / "msbot")
    assert (tmp_path / "msbot").read_text() == "something else"


def make_index(folder: Path, says: str) -> str:
    """Make an index with version 1.0 of a package that says something; returns the hash of its file."""
    place = folder / "blinker-box"
    place.mkdir(parents=True)
    name = "blinker_box-1.0-py3-none-any.whl"
    with zipfile.ZipFile(place / name, "w") as wheel:
        about = "blinker_box-1.0.dist-info"
        wheel.writestr("blinker_box.py", f"says = {says!r}\n")
        wheel.writestr(f"{about}/METADATA", "Metadata-Version: 2.1\nName: blinker-box\nVersion: 1.0\n")
        wheel.writestr(f"{about}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        wheel.writestr(f"{about}/RECORD", "")
    digest = hashlib.sha256((place / name).read_bytes()).hexdigest()
    (place / "index.html").write_text(f'<a href="{name}#sha256={digest}">{name}</a>')
    return digest


@pytest.mark.skipif(sys.platform == "win32", reason="make sets up Unix only; its folders are laid out otherwise there")
@pytest.mark.promise("What make installs is the file that the project was tested with, or the set-up says so")
def test_a_file_with_another_hash_is_refused_unless_somebody_wants_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    base = str(Path(sys.base_prefix, "bin", "python3"))  # .venv has no pip
    if subprocess.run([base, "-m", "pip", "--version"], capture_output=True, check=False).returncode:
        pytest.skip(f"{base} has no pip")
    monkeypatch.setattr("sys.executable", base)
    for name in [name for name in os.environ if name.startswith("PIP_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    tested = make_index(tmp_path / "tested", "tested")
    make_index(tmp_path / "changed", "changed")
    environment = tmp_path / "env"
    subprocess.run([base, "-m", "venv", "--without-pip", environment], check=True)
    python = str(environment / "bin" / "python")
    requirements = tmp_path / "run.txt"
    requirements.write_text(f"# what is installed\nblinker-box==1.0 \\\n    --hash=sha256:{tested}\n")

    def what_it_says() -> str:
        asked = [python, "-c", "import blinker_box; print(blinker_box.says)"]
        return subprocess.run(asked, capture_output=True, text=True, check=False).stdout.strip()

    monkeypatch.setenv("PIP_INDEX_URL", (tmp_path / "changed").as_uri())
    assert install_requirements(python, requirements, hashes=True)
    assert "make demo HASHES=no" in capfd.readouterr().err
    assert what_it_says() == ""
    # A second server with files of its own does no harm: pip takes the one with the hash.
    monkeypatch.setenv("PIP_EXTRA_INDEX_URL", (tmp_path / "tested").as_uri())
    assert not install_requirements(python, requirements, hashes=True)
    assert what_it_says() == "tested"
    shutil.rmtree(environment)
    subprocess.run([base, "-m", "venv", "--without-pip", environment], check=True)
    monkeypatch.delenv("PIP_EXTRA_INDEX_URL")
    assert not install_requirements(python, requirements, hashes=False)
    assert what_it_says() == "changed"
