"""Test suites of others against `msbot agent`, from what GoogleTest has printed: `bench/results/genuine_suites.md`.

    python -m bench.genuine_suites --of "Micro XRCE-DDS 3.0.1" [--write] NAME=LOG ...

The suites are built elsewhere, with an agent of theirs replaced by one that starts `msbot agent`. A case that a suite
was told to leave out (`--gtest_filter`) does not count.
"""

from __future__ import annotations

import argparse
import re
import sys
import time
from pathlib import Path

from bench.machine import describe_machine
from bench.result import write_result

PASSED = re.compile(r"^\[ +OK \] (\S+)", re.M)
RUN = re.compile(r"^\[ +RUN +\] (\S+)", re.M)


def row(name: str, text: str) -> str:
    """One suite: how many of its cases passed, and which did not."""
    run, passed = set(RUN.findall(text)), set(PASSED.findall(text))
    if not run:
        sys.exit(f"{name}: no case of GoogleTest was run in that log")
    failed = sorted(run - passed)
    return f"| {name} | {len(passed & run)} of {len(run)} | {', '.join(failed) or '-'} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+", metavar="NAME=LOG", help="a suite and what it has printed")
    parser.add_argument("--of", required=True, help="whose suites these are, with the version")
    parser.add_argument("--note", default="", help="what was left out, and why")
    parser.add_argument("--write", action="store_true", help="keep the table in bench/results")
    arguments = parser.parse_args()
    lines = [
        f"{describe_machine()}, {time.strftime('%Y-%m-%d')}; suites of {arguments.of}. {arguments.note}".strip(),
        "",
        "| suite | passed | failed |",
        "|---|---|---|",
    ]
    for one in arguments.logs:
        name, _, path = one.partition("=")
        lines.append(row(name, Path(path).read_text("utf-8", errors="replace")))
    print("\n".join(lines))
    if arguments.write:
        title = "Test suites of others against `msbot agent`"
        write_result("genuine_suites", title, lines, made_by="python -m bench.genuine_suites ... --write")


if __name__ == "__main__":
    main()
