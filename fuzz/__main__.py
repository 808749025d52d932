"""`python -m fuzz [TARGET...] --seconds N --seed S`, and `python -m fuzz --replay FILE`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from fuzz.case import load
from fuzz.engine import fuzz, run_case
from fuzz.targets import TARGETS

FINDINGS = Path(__file__).parent / "findings"


def main(arguments: list[str] | None = None) -> int:
    """Fuzz, or replay; returns 1 when something was found."""
    options = _options(arguments)
    if options.list:
        for target in TARGETS.values():
            print(f"{target.name:10} {target.about}")
        return 0
    if options.replay is not None:
        return _replay(options.replay)
    unknown = [name for name in options.targets if name not in TARGETS]
    if unknown:
        print(f"no such target: {', '.join(unknown)}; known: {', '.join(TARGETS)}", file=sys.stderr)
        return 2
    names = options.targets or list(TARGETS)
    found = 0
    for name in names:
        report = fuzz(
            TARGETS[name],
            seed=options.seed,
            findings=options.findings,
            seconds=options.seconds / len(names),
            executions=options.executions,
            told=lambda so_far: print(so_far, flush=True) if options.verbose else None,
        )
        print(report, flush=True)
        for path in report.files:
            print(f"    python -m fuzz --replay {path}", flush=True)
        found += len(report.findings)
    return 1 if found else 0


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m fuzz", description="Fuzz MsBOT's decoders and state machines.")
    parser.add_argument(
        "targets", nargs="*", metavar="TARGET", help=f"one or more of {', '.join(TARGETS)}; all if none"
    )
    parser.add_argument("--seconds", type=float, default=60.0, help="real time for all targets together (60)")
    parser.add_argument("--executions", type=int, help="cases for each target; a run that is the same every time")
    parser.add_argument("--seed", type=int, default=1, help="of the random numbers (1)")
    parser.add_argument("--replay", type=Path, metavar="FILE", help="run one stored case again")
    parser.add_argument("--findings", type=Path, default=FINDINGS, help="folder for reproducers")
    parser.add_argument("--list", action="store_true", help="list the targets")
    parser.add_argument("--verbose", action="store_true", help="print the figures every 10 s")
    return parser.parse_args(arguments)


def _replay(path: Path) -> int:
    name, case = load(path)
    for number, step in enumerate(case):
        print(
            f"{number:4} {step.verb:8} {step.numbers} {step.data[:60].hex(' ')}{' ...' if len(step.data) > 60 else ''}"
        )
    seen, finding = run_case(TARGETS[name], case)
    if finding is None:
        print(f"{name}: nothing goes wrong any more ({len(seen)} things seen)")
        return 0
    print(finding.trace)
    return 1


if __name__ == "__main__":
    sys.exit(main())
