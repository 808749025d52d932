"""All small mistakes of whole files, tried with the tests of these files alone; and which files have the most guards.

    PYTHONPATH=. python -m bench.mutating.whole_files                                   # the files, most guards first
    PYTHONPATH=. python -m bench.mutating.whole_files FILE=TESTS[,TESTS] ... [--kind guard] [--minutes 20] [--workers 2]

`bench/mutants.py` says how much of everything is noticed, by a sample. This says what is not noticed of one file, such
as `msbot/pnp/services.py=tests/pnp/test_services.py`; it needs no map, and another file's tests may notice the rest.
"""

from __future__ import annotations

import argparse
import ast
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue

from bench.mutants import LEFT_OUT, ROOMS, ROOT, Copy, mirrored
from bench.mutating.changes import Change, changes

USUAL_S = 10.0
"""Processor seconds that the tests of a file are taken for; thirteen times as many end a run."""


def kind_of(change: Change) -> str:
    """`guard`, `call`, `end` (what is returned, raised, or ends a loop) or `value`."""
    if change.new == "pass":
        return "end" if change.old.startswith("raise") else "call"
    if change.new.startswith(("return", "break", "continue")):
        return "end"
    was, now = _expression(change.old), _expression(change.new)
    guards = ast.Compare | ast.BoolOp
    is_not = any(isinstance(one, ast.UnaryOp) and isinstance(one.op, ast.Not) for one in (was, now))
    return "guard" if is_not or isinstance(was, guards) else "value"


def _expression(text: str) -> ast.expr | None:
    try:
        return ast.parse(f"({text})", mode="eval").body
    except SyntaxError:  # a statement
        return None


def list_files() -> None:
    """The files of the rooms with their mistakes by kind, and how many lines their own test file has."""
    rows: list[tuple[int, str, Counter[str], int]] = []
    for room in ROOMS:
        for path in sorted((ROOT / "src/msbot" / room).rglob("*.py")):
            name = str(path.relative_to(ROOT / "src"))
            kinds = Counter(map(kind_of, changes(name, path.read_text())))
            own = ROOT / mirrored(name)
            if LEFT_OUT not in name:
                rows.append((kinds["guard"], name, kinds, len(own.read_text().splitlines()) if own.exists() else 0))
    print("guards  values  calls  ends  lines of tests  file")
    for guards, name, kinds, lines in sorted(rows, reverse=True):
        print(f"{guards:6}  {kinds['value']:6}  {kinds['call']:5}  {kinds['end']:4}  {lines:14}  {name}")


def try_files(options: argparse.Namespace) -> None:
    """Print what survives."""
    wanted: list[tuple[Change, list[str]]] = []
    for words in options.files:
        name, _, tests = words.partition("=")
        every = changes(name, (ROOT / "src" / name).read_text())
        wanted += [(one, tests.split(",")) for one in every if options.kind in ("", kind_of(one))]
    end = time.monotonic() + 60 * options.minutes
    tried, survived = Counter[str](), Counter[str]()
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(options.workers) as pool:
        copies = [Copy(Path(folder) / f"worker{number}") for number in range(options.workers)]
        free: SimpleQueue[Copy] = SimpleQueue()
        for copy in copies:
            free.put(copy)

        def one(change: Change, tests: list[str]) -> None:
            if time.monotonic() > end:
                return
            copy = free.get()
            file = copy.source / change.path
            source = file.read_bytes()
            try:
                file.write_bytes(change.apply(source))
                word, _ = copy.run(tests, USUAL_S)
            finally:
                file.write_bytes(source)
                free.put(copy)
            tried[change.path] += 1
            if word == "survived":
                survived[change.path] += 1
                print(f"{kind_of(change):5} {change} in {change.function or 'the module'}", flush=True)

        try:
            list(pool.map(lambda pair: one(*pair), wanted))
        finally:
            for copy in copies:
                copy.close()
    for path, count in tried.items():
        print(f"{path}: {survived[path]} of {count} survived")


def main() -> None:
    """List, or try."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", metavar="FILE=TESTS")
    parser.add_argument("--kind", default="", choices=("", "guard", "value", "call", "end"))
    parser.add_argument("--minutes", type=float, default=1e9, help="begin none after that")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    if options.files:
        try_files(options)
    else:
        list_files()


if __name__ == "__main__":
    main()
