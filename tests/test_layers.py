"""The room table of CONTRIBUTING.md, kept by import-linter."""

import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent


def test_rooms_import_only_what_stands_below_them() -> None:
    tool = shutil.which("lint-imports", path=str(Path(sys.executable).parent))
    assert tool, "import-linter is not installed: run `make test`"
    run = subprocess.run([tool, "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr


def test_every_room_is_in_the_table() -> None:
    table = (ROOT / "CONTRIBUTING.md").read_text()
    rooms = [path for path in (ROOT / "src/msbot").iterdir() if path.is_dir() and path.name != "__pycache__"]
    for room in rooms:
        assert f"| `{room.name}` |" in table
