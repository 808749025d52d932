"""The six distributions: what each needs, how large it is, and how long `import` takes.

    python -m bench.distributions [--write]

Lines are those of Python files; the wheel is built as `make wheel` builds it. The import is the least processor time of
ten fresh processes, beside an empty one: of the package alone, and of the room that a program of that kind imports.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

from bench.machine import describe_machine
from bench.result import write_result
from tools.room_table import third_party
from tools.sources import PACKAGES, ROOT

USED = {
    "msbot_xrce": "msbot_xrce.sessions.client",
    "msbot_agent": "msbot_agent.agent.server",
    "msbot": "msbot.part.part",
    "msbot_school": "msbot_school.lessons.lesson_reader",
    "msbot_bridges": "msbot_bridges.bridge",
    "msbot_web": "msbot_web.assembly",
}
"""What a program of that distribution imports first."""
RUNS = 10


def import_ms(module: str) -> float:
    """Processor time of an import in a fresh process, beside an empty one."""
    script = "import time; began = time.process_time(); import {}; print(time.process_time() - began)"
    done = [
        subprocess.run([sys.executable, "-c", script.format(module)], capture_output=True, text=True, check=True)
        for _ in range(RUNS)
    ]
    return 1000 * min(float(one.stdout) for one in done)


def wheel_kb(project: Path, into: Path) -> float:
    """The size of the wheel of a distribution."""
    folder = into / project.name
    command = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(folder)]
    subprocess.run(command, cwd=project, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    return wheel.stat().st_size / 1000


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="keep it in bench/results")
    options = parser.parse_args()
    lines = [
        describe_machine(),
        "",
        "| distribution | needs | third parties | files | lines | wheel, kB | import, ms | first room of it, ms |",
        "|---|---|---|---|---|---|---|---|",
    ]
    total_files = total_lines = 0
    with tempfile.TemporaryDirectory() as folder:
        for package in PACKAGES:
            project = package.parents[1]
            wants = tomllib.loads((project / "pyproject.toml").read_text("utf-8"))["project"]["dependencies"]
            below = next((one.partition("=")[0].partition("[")[0] for one in wants if one.startswith("msbot")), "-")
            files = sorted(package.rglob("*.py"))
            count = sum(len(path.read_text("utf-8").splitlines()) for path in files)
            total_files, total_lines = total_files + len(files), total_lines + count
            used = USED[package.name]
            lines.append(
                f"| `{project.name}` | {below} | {', '.join(sorted(third_party(files))) or '-'} | {len(files)} | "
                f"{count:,} | {wheel_kb(project, Path(folder)):.0f} | {import_ms(package.name):.0f} | "
                f"`{used}` {import_ms(used):.0f} |"
            )
    lines.append(f"| all | | | {total_files} | {total_lines:,} | | | |")
    print("\n".join(lines))
    if options.write:
        made_by = "python -m bench.distributions --write"
        print(write_result("distributions", "The six distributions", lines, made_by=made_by).relative_to(ROOT))


if __name__ == "__main__":
    main()
