"""How often each promise of the docs on security and reliability was tried, and how often it held.

    python -m bench.promises [--minutes 10] [--write]

Runs every test that carries a promise (`@pytest.mark.promise`), again and again until the minutes are used up; each
round begins anew, with processes, sockets and files of its own. `--write` puts the table into
bench/results/promises.md. Exit status 1 unless every promise held each time.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from time import monotonic

from bench.machine import describe_machine
from tests.promises import Tally

ROOT = Path(__file__).parent.parent
RESULT = ROOT / "bench/results/promises.md"
NOTHING_COLLECTED = 5


def main() -> int:
    """Try, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0, help="begin no new round after these (default: 10)")
    parser.add_argument("--write", action="store_true", help=f"put the table into {RESULT.relative_to(ROOT)}")
    parser.add_argument("tests", nargs="*", help="folders or files of tests (default: all)")
    options = parser.parse_args()
    began, rounds = monotonic(), 0
    tallies: dict[str, Tally] = {}
    longest_s = 0.0
    while not rounds or monotonic() - began + longest_s < options.minutes * 60:
        round_began = monotonic()
        for promise, tally in try_once(options.tests).items():
            add(tallies.setdefault(promise, Tally()), tally)
        longest_s = max(longest_s, monotonic() - round_began)
        rounds += 1
    words = table(tallies, rounds)
    print(words)
    if options.write:
        RESULT.parent.mkdir(exist_ok=True)
        RESULT.write_text(words + "\n")
    return 0 if tallies and all(tally.tried == tally.held for tally in tallies.values()) else 1


def try_once(tests: list[str]) -> dict[str, Tally]:
    """One round of all tests with a promise."""
    with tempfile.NamedTemporaryFile(suffix=".json") as counted:
        command = [
            sys.executable,
            "-m",
            "pytest",
            "-m",
            "promise",
            "-p",
            "tests.promises",
            "--promises",
            counted.name,
            "-n",
            "2",
            "--dist",
            "loadfile",
            "-q",
            "--no-header",
            *tests,
        ]
        done = subprocess.run(
            command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
        )
        if done.returncode:
            sys.stderr.write(done.stdout)
        if done.returncode == NOTHING_COLLECTED:
            sys.exit("no test with a promise was found")
        text = Path(counted.name).read_text()
        if not text:
            sys.exit("pytest ended without a result; its output is above")
        return {promise: Tally(**values) for promise, values in json.loads(text).items()}


def add(sum_: Tally, more: Tally) -> None:
    """Add the counts of one round."""
    sum_.tried += more.tried
    sum_.held += more.held
    sum_.tests += [test for test in more.tests if test not in sum_.tests]
    sum_.skipped += [reason for reason in more.skipped if reason not in sum_.skipped]


def table(tallies: dict[str, Tally], rounds: int) -> str:
    """The table in Markdown."""
    lines = [
        "# Promises, tried and held",
        "",
        f"Made by `python -m bench.promises`; {rounds} {'round' if rounds == 1 else 'rounds'} on {describe_machine()}.",
        "",
        "| promise | tried | held | tests |",
        "|---|---:|---:|---|",
    ]
    for promise, tally in sorted(tallies.items()):
        tests = ", ".join(f"`{test}`" for test in sorted(tally.tests))
        lines.append(f"| {promise} | {tally.tried} | {tally.held} | {tests or 'none could be run here'} |")
    reasons = sorted({reason for tally in tallies.values() for reason in tally.skipped})
    if reasons:
        lines += ["", "Not run here:", "", *(f"* {reason}" for reason in reasons)]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
