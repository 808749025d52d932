"""A sample of small mistakes, put into the code one at a time: how many of them a test notices.

    PYTHONPATH=. python bench/mutants.py --map FILE.json             # which test calls what; once, some minutes
    PYTHONPATH=. python bench/mutants.py --with FILE.json [--count 200] [--seed 1] [--workers 2] [--keep FILE.jsonl]
    PYTHONPATH=. python bench/mutants.py --with FILE.json --only 'msbot/xrce/x.py:12 `a` -> `b`'   # one of them again

A mistake is an operator, a number, a condition or a statement that is another one (`bench/mutating/changes.py`). It is
put into a copy of `src`; then the tests run which call the function it is in, first those of the folder that mirrors
its room, and stop at the first that fails. A mistake that makes a test fail, or take many times its processor time, is
killed; what survives is printed: it wants a test, or a reason why nobody can see it. Mistakes in functions that no test
calls in its own process are counted as surviving. Exit status 1 when fewer than 90 % are killed. Linux; where other
masters run, in a network of its own (`unshare -n`, `ip link set lo up`).
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from random import Random

from bench.machine import describe_machine
from bench.mutating.changes import Change, changes
from bench.mutating.runner import FELL

ROOT = Path(__file__).parent.parent
ROOMS = ("xrce", "link", "pnp", "registry")
LEFT_OUT = "/migrations/"
"""Each migration runs once, in databases of yesterday."""
TESTS = (
    "tests/xrce", "tests/link", "tests/pnp", "tests/registry", "tests/agent", "tests/part", "tests/space",
    "tests/operations", "tests/conformance", "tests/web/test_part_socket.py",
    "tests/web/test_part_socket_failures.py",
)  # fmt: skip
GOAL = 0.9
FIRST_TESTS, FIRST_FILES = 40, 4
"""What runs at first; most mistakes are noticed by that."""
MOST_TESTS, MOST_FILES = 150, 15
MOST_S = 12.0
"""Processor seconds of tests for one mistake."""


class Users:
    """Which functions use a name that a file gives a value outside of all functions."""

    def __init__(self) -> None:
        self._words: dict[str, list[tuple[str, set[str]]]] = {}
        """By file: its functions and the words in each; and, as function "", those outside."""
        self._imports: dict[str, set[str]] = {}
        for path in sorted((ROOT / "src/msbot").rglob("*.py")):
            tree = ast.parse(path.read_text())
            file = str(path.relative_to(ROOT / "src"))
            self._words[file] = [*_functions(tree, [])]
            self._imports[file] = {
                (one.module or "").replace(".", "/") + ".py"
                for one in ast.walk(tree)
                if isinstance(one, ast.ImportFrom)
            }

    def of(self, path: str, name: str) -> list[str]:
        """`msbot/xrce/....py Class.method` of each, in that file and those that import it."""
        if not name:
            return []
        files = [path, *(file for file, imported in self._imports.items() if path in imported)]
        return [
            f"{file} {function}" for file in files for function, words in self._words[file] if name in words
        ]  # fmt: skip


def _functions(tree: ast.AST, names: list[str]) -> Iterator[tuple[str, set[str]]]:
    """The functions and methods of a file, and the words in each; the methods of a class use the class."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.ClassDef):
            yield from ((function, words | {node.name}) for function, words in _functions(node, [*names, node.name]))
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            inside = [*ast.walk(node)]
            words = {one.id for one in inside if isinstance(one, ast.Name)}
            yield ".".join([*names, node.name]), words | {one.attr for one in inside if isinstance(one, ast.Attribute)}


@dataclass(frozen=True, slots=True)
class Tests:
    """Which tests call what."""

    by_function: dict[str, list[str]]
    by_file: dict[str, list[str]]
    seconds: dict[str, float]
    users: Users

    @classmethod
    def read(cls, files: Iterable[Path]) -> Tests:
        """What `--map` has written; of a test that is in several files, what the last one says."""
        found = {test: noted for file in files for test, noted in json.loads(file.read_text()).items()}
        by_function: dict[str, list[str]] = {}
        by_file: dict[str, list[str]] = {}
        for test, (_, functions) in found.items():
            for function in functions:
                by_function.setdefault(function, []).append(test)
            for path in {function.partition(" ")[0] for function in functions}:
                by_file.setdefault(path, []).append(test)
        return cls(by_function, by_file, {test: seconds for test, (seconds, _) in found.items()}, Users())

    def of(self, change: Change) -> list[str]:
        """The tests that may notice it, the best first: near by, and cheap."""
        of_file = self.by_file.get(change.path, [])
        if change.function:
            tests = {*self.by_function.get(f"{change.path} {change.function}", [])}
        else:
            users = self.users.of(change.path, change.name)
            tests = {test for user in users for test in self.by_function.get(user, [])}
        # A property may reach the function only after more random cases than the map was made with; and a file without
        # functions is called by nobody.
        also = [test for test in of_file or self.seconds if _is_mirror(change.path, test)]
        if not change.function and not tests:
            also += of_file
        near_first = not change.function  # for what acts when the file is imported, the users are many
        order = {
            test: (not near_first and test not in tests, -_near(change.path, test), self.seconds[test], test)
            for test in {*tests, *also}
        }
        return sorted(order, key=order.__getitem__)


def mirrored(path: str) -> Path:
    """The test file of that name."""
    return Path("tests", *Path(path).parts[1:]).with_name(f"test_{Path(path).name}")


def _is_mirror(path: str, test: str) -> bool:
    """Whether a test is in the folder that mirrors the file's, or in the one above it."""
    folder = Path(test.partition("::")[0]).parent
    own = mirrored(path).parent
    return folder in (own, own.parent) and len(folder.parts) > 1


def _near(path: str, test: str) -> int:
    """How alike the folders and names are."""
    own = mirrored(path)
    there = Path(test.partition("::")[0])
    alike = sum(one == other for one, other in zip(own.parts, there.parts, strict=False))
    return alike + 2 * (own.name == there.name)


def limited(tests: list[str], seconds: dict[str, float], most: int, files: int) -> list[str]:
    """The first of them, as far as the limits go."""
    kept: list[str] = []
    seen: set[str] = set()
    left = MOST_S
    for test in tests:
        file = test.partition("::")[0]
        if (file not in seen and len(seen) == files) or (kept and seconds[test] > left):
            continue
        seen.add(file)
        left -= seconds[test]
        kept.append(test)
        if len(kept) == most:
            break
    return kept


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of a mistake."""

    change: Change
    word: str
    """`killed`, `killed: never ends`, `survived` or `no test calls it`."""
    tests: int
    seconds: float
    by: str = ""
    """The test that noticed it."""


class Copy:
    """A copy of `src`, and a process that runs tests with it."""

    def __init__(self, folder: Path) -> None:
        self.source = folder / "src"
        shutil.copytree(ROOT / "src", self.source, symlinks=True)
        for beside in ROOT.iterdir():  # lessons, examples: what a source tree has beside `src`
            if beside.is_dir() and beside.name != "src" and not beside.name.startswith("."):
                (folder / beside.name).symlink_to(beside)
        subprocess.run([sys.executable, "-m", "compileall", "-q", str(self.source)], check=True)
        self._output = folder / "output"
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "XDG_STATE_HOME": str(folder / "state")}
        self._runner = subprocess.Popen(
            [sys.executable, "-m", "bench.mutating.runner"], cwd=ROOT, env=environment, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip

    def run(self, tests: list[str], usual_s: float) -> tuple[str, str]:
        """What pytest says of these tests with this code, and the test that has failed."""
        assert self._runner.stdin is not None
        assert self._runner.stdout is not None
        request = {"source": str(self.source), "tests": tests, "seconds": int(30 + 10 * usual_s),
                   "output": str(self._output)}  # fmt: skip
        self._runner.stdin.write(json.dumps(request) + "\n")
        self._runner.stdin.flush()
        status = int(self._runner.stdout.readline())
        said = self._output.read_text(errors="replace")
        if status == 0:
            return "survived", ""
        if status < 0:
            return "killed: never ends", ""
        if missing := re.findall(r"^ERROR: not found: \S*?(tests/\S+)", said, re.MULTILINE):
            found = [one for one in tests if not one.startswith(tuple(missing))]  # its name cannot be given on a line
            return self.run(found, usual_s) if found and len(found) < len(tests) else ("survived", "")
        if status == FELL and "PytestUnraisableExceptionWarning" in said:
            return "killed", "what is left behind at the end"  # pytest itself does not get over several of these
        failed = [line for line in said.splitlines() if line.startswith(("FAILED ", "ERROR tests/"))]
        if status not in (1, 2, 4) or "ERROR: file or directory not found" in said:
            raise SystemExit(f"pytest ends with {status}: {said[-2000:]}")
        return "killed", failed[0].split(" - ")[0].split(" ", 1)[1] if failed else "msbot cannot be imported"

    def close(self) -> None:
        """End the process."""
        self._runner.kill()
        self._runner.communicate()


class Bench:
    """Copies of `src` in which mistakes are made."""

    def __init__(self, folder: Path, tests: Tests, workers: int) -> None:
        self._tests = tests
        self._free: SimpleQueue[Copy] = SimpleQueue()
        self._copies = [Copy(folder / f"worker{number}") for number in range(workers)]
        for copy in self._copies:
            self._free.put(copy)

    def close(self) -> None:
        """End what runs the tests."""
        for copy in self._copies:
            copy.close()

    def try_out(self, change: Change) -> Verdict:
        """Make it, run the tests, take it back."""
        began = time.monotonic()
        tests = self._tests.of(change)
        if not tests:
            return Verdict(change, "no test calls it", 0, 0.0)
        copy = self._free.get()
        file = copy.source / change.path
        source = file.read_bytes()
        ran: list[str] = []
        try:
            file.write_bytes(change.apply(source))
            for most, files in ((FIRST_TESTS, FIRST_FILES), (MOST_TESTS, MOST_FILES)):
                more = [one for one in limited(tests, self._tests.seconds, most, files) if one not in ran]
                if not more:
                    continue
                ran += more
                word, by = copy.run(more, sum(self._tests.seconds[one] for one in more))
                if word != "survived":
                    return Verdict(change, word, len(ran), time.monotonic() - began, by)
        finally:
            file.write_bytes(source)
            self._free.put(copy)
        return Verdict(change, "survived", len(ran), time.monotonic() - began)


def sample(seed: int, count: int) -> list[Change]:
    """By chance, as many from each room as are its share."""
    found: list[Change] = []
    for room in ROOMS:
        for path in sorted((ROOT / "src/msbot" / room).rglob("*.py")):
            name = str(path.relative_to(ROOT / "src"))
            if LEFT_OUT not in name:
                found += changes(name, path.read_text())
    return Random(seed).sample(found, min(count, len(found)))


def room_of(change: Change) -> str:
    """`xrce`, `link`, ..."""
    return change.path.split("/")[1]


def table(verdicts: list[Verdict]) -> str:
    """For people."""
    lines = ["| room | mistakes | killed | share |", "|---|---|---|---|"]
    all_of, killed = Counter(room_of(one.change) for one in verdicts), Counter[str]()
    killed.update(room_of(one.change) for one in verdicts if one.word.startswith("killed"))
    for room in ROOMS:
        if all_of[room]:
            lines.append(f"| `{room}` | {all_of[room]} | {killed[room]} | {killed[room] / all_of[room]:.0%} |")
    lines.append(f"| all | {all_of.total()} | {killed.total()} | {killed.total() / all_of.total():.0%} |")
    return "\n".join(lines)


def make_map(file: Path, tests: Iterable[str]) -> None:
    """Run the tests once."""
    words = ["-m", "pytest", "-n0", "-q", "-p", "no:cacheprovider", "-p", "bench.mutating.called"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    subprocess.run([sys.executable, *words, "--called", str(file), *tests], cwd=ROOT, env=environment, check=False)


def main() -> None:
    """Make the map, or try mistakes out."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--map", type=Path, metavar="FILE", help="note which test calls what")
    parser.add_argument("--of", nargs="*", default=TESTS, metavar="TESTS", help="of these tests alone")
    parser.add_argument(
        "--with",
        type=Path,
        metavar="FILE",
        dest="noted",
        action="append",
        help="what --map has written; may be repeated",
    )
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=1e9, help="begin none after that")
    parser.add_argument(
        "--keep", type=Path, metavar="FILE", help="what became of each, a line each; what is there is not tried again"
    )
    parser.add_argument(
        "--only", metavar="MISTAKE", action="append", help="the one that is printed so; may be repeated"
    )
    options = parser.parse_args()
    if options.map:
        make_map(options.map, options.of)
    if options.noted is None:
        return
    wanted = sample(options.seed, 10**9 if options.only else options.count)
    if options.only:
        wanted = [one for one in wanted if str(one) in options.only]
    verdicts = try_all(options, wanted)
    print(f"\n{table(verdicts)}\n\nSeed {options.seed}; {describe_machine()}.")
    for one in verdicts:
        if not one.word.startswith("killed"):
            print(f"* {one.change} in {one.change.function or 'the module'}: {one.word} ({one.tests} tests)")
    sys.exit(sum(one.word.startswith("killed") for one in verdicts) < GOAL * len(verdicts))


def try_all(options: argparse.Namespace, wanted: list[Change]) -> list[Verdict]:
    """All that are wanted, as far as the time goes."""
    before: dict[str, dict[str, object]] = {}
    if options.keep and options.keep.exists():
        before = {line["mistake"]: line for line in map(json.loads, options.keep.read_text().splitlines())}
    end = time.monotonic() + 60 * options.minutes
    with tempfile.TemporaryDirectory() as name, ThreadPoolExecutor(options.workers) as pool:
        bench = Bench(Path(name), Tests.read(options.noted), options.workers)

        def one(change: Change) -> Verdict | None:
            known = before.get(str(change))
            if known is not None:
                return Verdict(change, str(known["word"]), int(str(known["tests"])), float(str(known["seconds"])))
            if time.monotonic() > end:
                return None
            verdict = bench.try_out(change)
            print(
                f"{verdict.word:18} {verdict.seconds:5.1f} s {verdict.tests:4} tests  {change}  {verdict.by}",
                flush=True,
            )
            if options.keep:
                line = {"mistake": str(change), "function": change.function, "word": verdict.word,
                        "tests": verdict.tests, "seconds": verdict.seconds, "by": verdict.by}  # fmt: skip
                with options.keep.open("a") as kept:
                    kept.write(json.dumps(line) + "\n")
            return verdict

        try:
            return [found for found in pool.map(one, wanted) if found is not None]
        finally:
            bench.close()


if __name__ == "__main__":
    main()
