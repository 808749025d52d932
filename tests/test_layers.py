"""The rooms of packages/README.md, kept by import-linter."""

import shutil
import subprocess
import sys
from pathlib import Path

from tools.sources import PACKAGES

ROOT = Path(__file__).parent.parent


def test_rooms_import_only_what_stands_below_them() -> None:
    tool = shutil.which("lint-imports", path=str(Path(sys.executable).parent))
    assert tool, "import-linter is not installed: run `make test`"
    run = subprocess.run([tool, "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr


def test_every_room_is_on_the_page() -> None:
    page = (ROOT / "packages/README.md").read_text()
    for package in PACKAGES:
        rooms = [path for path in package.iterdir() if path.is_dir() and (path / "__init__.py").is_file()]
        assert rooms
        missing = [room.name for room in rooms if f" `{package.name}.{room.name}`:" not in page]
        assert not missing or package.name in ("msbot_xrce", "msbot_web"), missing
