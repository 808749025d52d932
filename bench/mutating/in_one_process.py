"""All small mistakes of whole files, in copies of one process that has collected the tests: tens of milliseconds each.

    PYTHONPATH=. python -m bench.mutating.in_one_process --with MAP.json --tests tests/link FILE ... [--keep FILE.jsonl]

`MAP.json` is what `bench/mutants.py --map` or `bench.mutating.called` has written: which test calls what. For each
mistake the process forks; the copy puts the mistake in (the code of the function that has it, a default, or a value of
the module or class, wherever it is known by that name), and runs the tests which call that function, those of the file
of the same name first and then the cheapest, up to `--seconds` of processor time. What survives is printed. Not tried,
and counted apart: what only acts while a file is imported (members of an enumeration, tables made of such values).
"""

from __future__ import annotations

import argparse
import ast
import gc
import importlib
import json
import os
import resource
import select
import signal
import sys
import time
import traceback
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import pytest
from hypothesis import Phase, settings

from bench.mutants import ROOT, Tests, mirrored
from bench.mutating.changes import Change, changes
from bench.mutating.whole_files import kind_of

IDLE_S = 10.0
"""Real seconds after which a copy that does nothing counts as one that never ends."""
PATIENCE_S = 60.0
"""The same for one that does little."""
FLAGS = ("-n0", "-q", "-p", "no:cacheprovider", "-p", "no:schemathesis", "-p", "no:anyio", "--timeout", "0",
         "-W", "ignore::pytest.PytestAssertRewriteWarning")  # fmt: skip
CANNOT = 3
"""Exit status of a copy: this mistake cannot be put in here."""


KILLED = ("killed", "killed: never ends")


class CannotBePutIn(Exception):
    """It acts only while the file is imported."""


def module_of(path: str) -> ModuleType:
    """Of `msbot/link/base.py`, say."""
    return importlib.import_module(path.removesuffix(".py").removesuffix("/__init__").replace("/", "."))


def put_in(change: Change, functions: dict[tuple[str, str], list[FunctionType]]) -> None:
    """Change the running program as the mistake would."""
    module = module_of(change.path)
    source = Path(str(module.__file__)).read_bytes()
    changed = change.apply(source)
    if change.function:
        top = change.function.partition(".<locals>")[0]
        old, new = _codes(compile(source, "x", "exec"), top), _codes(compile(changed, "x", "exec"), top)
        place = next((number for number, one in enumerate(old) if _differ(one, new[number])), None)
        own = sorted(functions.get((str(module.__file__), top), []), key=lambda one: one.__code__.co_firstlineno)
        if place is not None:
            for function in own:
                if function.__code__.co_firstlineno == old[place].co_firstlineno:
                    _give(function, new[place])
            return
        if not own:
            raise CannotBePutIn
        _change_default(change, changed, own, module)
        return
    _change_value(source, changed, module)


def _codes(code: CodeType, name: str) -> list[CodeType]:
    found = []
    for one in code.co_consts:
        if isinstance(one, CodeType):
            found += [one] if one.co_qualname == name else _codes(one, name)
    return found


def _differ(one: CodeType, other: CodeType) -> bool:
    return one.co_code != other.co_code or [
        _plain(each) for each in one.co_consts
    ] != [_plain(each) for each in other.co_consts] or (one.co_names, one.co_varnames) != (
        other.co_names, other.co_varnames,
    )  # fmt: skip


def _plain(constant: object) -> object:
    if isinstance(constant, CodeType):
        return (constant.co_code, [_plain(one) for one in constant.co_consts], constant.co_names)
    return (type(constant), repr(constant))


def _give(function: FunctionType, code: CodeType) -> None:
    wanted = function.__code__.co_freevars
    if code.co_freevars != wanted:
        if code.co_freevars:
            raise CannotBePutIn
        code = code.replace(co_freevars=wanted)  # it no longer looks at any
    function.__code__ = code.replace(co_filename=function.__code__.co_filename)


def _change_default(change: Change, changed: bytes, own: list[FunctionType], module: ModuleType) -> None:
    """Evaluate the defaults anew."""
    line = change.line
    for node in ast.walk(ast.parse(changed)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.name == own[0].__name__:
            last = node.body[0].lineno
            if not node.lineno <= line <= last:
                continue
            given = {**module.__dict__}
            values = tuple(_evaluate(one, given) for one in node.args.defaults)
            named = {
                argument.arg: _evaluate(one, given)
                for argument, one in zip(node.args.kwonlyargs, node.args.kw_defaults, strict=True)
                if one is not None
            }
            for function in own:
                function.__defaults__, function.__kwdefaults__ = values or None, named or None
            return
    raise CannotBePutIn


def _evaluate(node: ast.expr, given: dict[str, Any]) -> object:
    value: object = eval(compile(ast.Expression(node), "default", "eval"), given)
    return value


def _change_value(source: bytes, changed: bytes, module: ModuleType) -> None:
    """What a module or a class gives a name."""
    before, after = ast.parse(source).body, ast.parse(changed).body
    for number, (old, new) in enumerate(zip(before, after, strict=True)):
        if ast.dump(old) == ast.dump(new):
            continue
        if isinstance(new, ast.ClassDef):
            _change_class(old, new, module)
        else:
            _run_again(after[number:], new, module)
        return
    raise CannotBePutIn


def _names(node: ast.stmt) -> list[str]:
    targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
    return [one.id for target in targets for one in ast.walk(target) if isinstance(one, ast.Name)]


def _run_again(statements: list[ast.stmt], first: ast.stmt, module: ModuleType) -> None:
    """This statement, and those after it that use what it gives."""
    given = {**module.__dict__}
    fresh: set[str] = set()
    for one in statements:
        uses = {name.id for name in ast.walk(one) if isinstance(name, ast.Name)} & fresh
        if (one is first or uses) and (names := _names(one)):
            exec(compile(ast.Module([one], []), "value", "exec"), given)
            fresh |= {*names}
    if not fresh:
        raise CannotBePutIn
    for name in fresh:
        _say_everywhere(name, module.__dict__[name], given[name])


def _say_everywhere(name: str, old: object, new: object) -> None:
    for module in [*sys.modules.values()]:
        is_ours = module is not None and module.__name__.partition(".")[0] in ("msbot", "tests")
        if is_ours and module.__dict__.get(name) is old:
            setattr(module, name, new)


def _change_class(old: ast.stmt, new: ast.ClassDef, module: ModuleType) -> None:
    assert isinstance(old, ast.ClassDef)
    owner = getattr(module, new.name)
    for was, now in zip(old.body, new.body, strict=True):
        if ast.dump(was) == ast.dump(now):
            continue
        names = _names(now)
        if not names or hasattr(owner, "__members__"):
            raise CannotBePutIn
        given: dict[str, Any] = {**module.__dict__, **vars(owner)}
        exec(compile(ast.Module([now], []), "value", "exec"), given)
        value = given[names[0]]
        if hasattr(owner, "__dataclass_fields__") and names[0] in owner.__dataclass_fields__:
            if type(value).__name__ == "Field":
                raise CannotBePutIn
            begin = owner.__init__
            fields = [one for one in owner.__dataclass_fields__.values() if one.init]
            positional = [one.name for one in fields if not one.kw_only]
            if names[0] in positional:
                at = positional.index(names[0]) - len(positional)
                defaults = [*begin.__defaults__]
                defaults[at] = value
                begin.__defaults__ = (*defaults,)
            else:
                begin.__kwdefaults__[names[0]] = value
            if names[0] not in getattr(owner, "__slots__", ()):
                setattr(owner, names[0], value)
        else:
            setattr(owner, names[0], value)
        return
    raise CannotBePutIn


@dataclass
class Running:
    """A copy that tries a mistake."""

    change: Change
    process: int
    answer: int
    seen_s: float = 0.0
    """Its processor seconds when it was last looked at."""
    began: float = field(default_factory=time.monotonic)
    since: float = field(default_factory=time.monotonic)


class Trial:
    """A plugin of pytest: after collecting, forks for each mistake instead of running all tests."""

    def __init__(self, options: argparse.Namespace, wanted: list[Change], tests: Tests) -> None:
        self._options, self._wanted, self._tests = options, wanted, tests
        self._killers: dict[str, list[str]] = {}
        self.tried: Counter[str] = Counter()
        self.survived: Counter[str] = Counter()
        self.left_out: Counter[str] = Counter()
        self._failed = False
        self._keep = options.keep.open("a") if options.keep else None

    def pytest_sessionstart(self) -> None:
        """Failures need not be made small, nor remembered."""
        quick = settings(settings.get_profile("msbot"), database=None, derandomize=self._options.same_cases,
                         phases=(Phase.explicit, Phase.generate))  # fmt: skip
        settings.register_profile("quick", quick)
        settings.load_profile("quick")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """In a copy."""
        self._failed = self._failed or report.failed

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Try all."""
        items = {item.nodeid: item for item in session.items}
        gc.unfreeze()
        functions: dict[tuple[str, str], list[FunctionType]] = {}
        for one in gc.get_objects():
            if isinstance(one, FunctionType):
                functions.setdefault((one.__code__.co_filename, one.__code__.co_qualname), []).append(one)
        gc.collect()
        gc.freeze()
        left = [*reversed(self._wanted)]
        running: list[Running] = []
        while left or running:
            while left and len(running) < self._options.workers:
                change = left.pop()
                chosen = self._chosen(change, items)
                if chosen:
                    running.append(self._begin(change, chosen, functions))
                else:
                    self._note(change, "no test calls it", "")
            self._look_after(running)
        return True

    def _chosen(self, change: Change, items: dict[str, pytest.Item]) -> list[pytest.Item]:
        own = str(mirrored(change.path))
        seconds = self._tests.seconds
        names = [one for one in self._tests.of(change) if one in items]
        calling = {*self._tests.by_function.get(f"{change.path} {change.function}", [])}
        names.sort(key=lambda one: (one not in calling, not one.startswith(own), seconds[one]))
        killers = [one for one in self._killers.get(change.function, []) if one in names]
        spent, chosen = 0.0, list[pytest.Item]()
        for name in dict.fromkeys([*killers, *names]):
            if not chosen or spent + seconds[name] <= self._options.seconds:
                chosen.append(items[name])
                spent += seconds[name]
        return chosen

    def _begin(
        self, change: Change, items: list[pytest.Item], functions: dict[tuple[str, str], list[FunctionType]]
    ) -> Running:
        reads, writes = os.pipe()
        process = os.fork()
        if process:
            os.close(writes)
            return Running(change, process, reads)
        code = 1
        try:
            os.setsid()
            quiet = os.open(os.devnull, os.O_RDWR)
            for number in (0, 1, 2):
                if not self._options.loud:
                    os.dup2(quiet, number)
            most = int(4 + 4 * self._options.seconds)
            resource.setrlimit(resource.RLIMIT_CPU, (most, most + 2))
            resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))
            if not self._options.no_mistake:
                put_in(change, functions)
            for number, item in enumerate(items):
                following = items[number + 1] if number + 1 < len(items) else None
                item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
                if self._failed:
                    os.write(writes, item.nodeid.encode())
                    break
            code = 1 if self._failed else 0
        except CannotBePutIn:
            code = CANNOT
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(code)

    def _look_after(self, running: list[Running]) -> None:
        ready, _, _ = select.select([one.answer for one in running], [], [], 0.5)
        for one in [*running]:
            done, status = os.waitpid(one.process, os.WNOHANG)
            if not done and one.answer not in ready:
                spent = _spent_s(one.process)
                now = time.monotonic()
                if spent > one.seen_s + 0.01:
                    one.seen_s, one.since = spent, now
                if now > min(one.since + IDLE_S, one.began + PATIENCE_S):
                    os.killpg(one.process, signal.SIGKILL)
                continue
            by = os.read(one.answer, 4096).decode()
            if not done:
                _, status = os.waitpid(one.process, 0)
            os.close(one.answer)
            running.remove(one)
            with suppress(ProcessLookupError):
                os.killpg(one.process, signal.SIGKILL)  # what its tests have left behind
            code = os.waitstatus_to_exitcode(status)
            if by:
                self._killers.setdefault(one.change.function, [])
                killers = self._killers[one.change.function]
                if by in killers:
                    killers.remove(by)
                killers.insert(0, by)
            words = {0: "survived", CANNOT: "not tried"}
            self._note(one.change, words.get(code, "killed" if code > 0 else "killed: never ends"), by)

    def _note(self, change: Change, word: str, by: str) -> None:
        if word == "not tried":
            self.left_out[change.path] += 1
        else:
            self.tried[change.path] += 1
        if word in ("survived", "no test calls it"):
            self.survived[change.path] += 1
        if word in ("survived", "no test calls it", "not tried"):
            line = f"{kind_of(change):5} {word}: {change} in {change.function or 'the module'}\n"
            os.write(self._options.out, line.encode())
        if self._keep:
            self._keep.write(json.dumps({"change": str(change), "word": word, "by": by}) + "\n")
            self._keep.flush()


def _spent_s(process: int) -> float:
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")


def main() -> None:
    """Collect, fork, tell."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", metavar="FILE", help="such as msbot/link/base.py")
    parser.add_argument("--with", type=Path, dest="noted", action="append", required=True, metavar="MAP.json")
    parser.add_argument("--tests", nargs="+", required=True, metavar="TESTS", help="those to collect")
    parser.add_argument("--seconds", type=float, default=2.5, help="of tests for one mistake")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", default="", help="mistakes whose description has this text")
    parser.add_argument("--keep", type=Path, metavar="FILE.jsonl", help="write down what became of each; go on there")
    parser.add_argument("--again", type=Path, metavar="FILE.jsonl", help="only what survived according to this")
    parser.add_argument("--loud", action="store_true", help="show what the tests say")
    parser.add_argument("--no-mistake", action="store_true", help="put nothing in: nothing may be noticed then")
    parser.add_argument("--same-cases", action="store_true", help="random cases are the same each time")
    options = parser.parse_args()
    options.out = os.dup(1)
    wanted = [
        one
        for name in options.files
        for one in changes(name, (ROOT / "src" / name).read_text())
        if options.only in str(one)
    ]
    if options.keep and options.keep.exists():
        done = {json.loads(line)["change"] for line in options.keep.read_text().splitlines()}
        wanted = [one for one in wanted if str(one) not in done]
    if options.again:
        notes = [json.loads(line) for line in options.again.read_text().splitlines()]
        left = {note["change"] for note in notes if note["word"] not in KILLED}
        wanted = [one for one in wanted if str(one) in left]
    trial = Trial(options, wanted, Tests.read(options.noted))
    pytest.main([*FLAGS, *(["-s"] if options.loud else []), *options.tests], plugins=[trial])
    for path, count in trial.tried.items():
        out = f", {trial.left_out[path]} not tried" if trial.left_out[path] else ""
        print(f"{path}: {trial.survived[path]} of {count} survived{out}")


if __name__ == "__main__":
    main()
