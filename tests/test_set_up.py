"""The set-up of `make demo`, where the folder has a name that not every locale can write."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tools.set_up import point_without_letters


@pytest.mark.skipif(sys.platform == "win32", reason="make sets up Unix only; its folders are laid out otherwise there")
def test_a_folder_with_an_umlaut_is_found_in_the_locale_c_too(tmp_path: Path) -> None:
    home = tmp_path / "Robo Tür 1"
    (home / "src" / "msbot").mkdir(parents=True)
    (home / "src" / "msbot" / "__init__.py").write_text("here = 'found'\n")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", home / ".venv"], check=True)
    (packages,) = (home / ".venv").glob("lib/python*/site-packages")
    pointer = packages / "_editable_impl_msbot.pth"
    pointer.write_text(f"{home / 'src'}\n", encoding="utf-8")  # as pip leaves it

    point_without_letters(home / ".venv")

    assert pointer.read_text().isascii()
    started = subprocess.run(
        [home / ".venv" / "bin" / "python", "-c", "import msbot; print(msbot.here)"],
        env={**os.environ, "LC_ALL": "C"}, cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (started.stdout, started.stderr) == ("found\n", "")
