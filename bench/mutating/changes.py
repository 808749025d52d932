"""Every small change that can be made to a file of Python: one operator, number, condition or statement."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass

_COMPARE: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
_BINARY: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.FloorDiv, ast.FloorDiv: ast.Mult, ast.Div: ast.Mult,
    ast.Mod: ast.Mult, ast.LShift: ast.RShift, ast.RShift: ast.LShift, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
    ast.BitXor: ast.BitAnd,
}  # fmt: skip
_LOGGERS = ("log", "_log", "_LOG", "LOG", "logger")


@dataclass(frozen=True, slots=True)
class Change:
    """One change of one file."""

    path: str
    """From the folder above the package, as `msbot/xrce/...`."""
    function: str
    """The qualified name of the function it is in, or whose default it is; empty: outside of all."""
    name: str
    """Outside of all: the name that is given a value there, or the class; else empty."""
    line: int
    begin: int
    """Octets in the file: what is replaced."""
    end: int
    old: str
    new: str

    def apply(self, source: bytes) -> bytes:
        """The file with this change."""
        return source[: self.begin] + self.new.encode() + source[self.end :]

    def __str__(self) -> str:
        return f"{self.path}:{self.line} {_short(self.old)} -> {_short(self.new)}"


def changes(path: str, source: str) -> Iterator[Change]:
    """All changes of a file, in the order of its lines."""
    finder = _Finder(path, source)
    finder.visit(ast.parse(source))
    yield from finder.found


class _Finder(ast.NodeVisitor):
    """Leaves out what no run of the program shows: annotations, texts, assertions for the type checker, log lines."""

    def __init__(self, path: str, source: str) -> None:
        self.found: list[Change] = []
        self._path, self._source = path, source.encode()
        self._starts = [0]
        for line in self._source.splitlines(keepends=True):
            self._starts.append(self._starts[-1] + len(line))
        self._names: list[str] = []
        self._function = ""
        self._is_default = False
        self._assigned = ""

    # What is not changed.

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self._visit_value([node.target], node.value)

    def visit_arg(self, node: ast.arg) -> None: ...

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None: ...  # CPython 3.11 does not know where its parts are

    def visit_Assert(self, node: ast.Assert) -> None: ...

    def visit_Import(self, node: ast.Import) -> None: ...

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None: ...

    # Names.

    def visit_Assign(self, node: ast.Assign) -> None:
        for target in node.targets:
            self.visit(target)
        self._visit_value(node.targets, node.value)

    def _visit_value(self, targets: list[ast.expr], value: ast.expr) -> None:
        outer = self._assigned
        names = [one.id for one in targets if isinstance(one, ast.Name)]
        if names and not self._function:
            self._assigned = self._names[0] if self._names else names[0]
        self.visit(value)
        self._assigned = outer

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        self._names.append(node.name)
        for one in node.body:
            self.visit(one)
        self._names.pop()

    def visit_FunctionDef(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        outer = self._function
        self._names.append(node.name)
        self._function = ".".join(self._names)
        self._is_default = not outer
        for default in [*node.args.defaults, *(one for one in node.args.kw_defaults if one)]:
            self.visit(default)
        self._is_default = False
        self._names.append("<locals>")
        for one in node.body:
            self.visit(one)
        del self._names[-2:]
        self._function = outer

    visit_AsyncFunctionDef = visit_FunctionDef

    # What is changed.

    def visit_Compare(self, node: ast.Compare) -> None:
        for number, operator in enumerate(node.ops):
            other = [*node.ops]
            other[number] = _COMPARE[type(operator)]()
            self._add(node, ast.Compare(node.left, other, node.comparators))
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        other = ast.Or() if isinstance(node.op, ast.And) else ast.And()
        self._add(node, ast.BoolOp(other, node.values))
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        if isinstance(node.op, ast.Not):
            self._add(node, node.operand)
        self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        is_text = any((isinstance(one, ast.Constant) and not isinstance(one.value, int | float | bytes))
                      or isinstance(one, ast.JoinedStr) for one in (node.left, node.right))  # fmt: skip
        if type(node.op) in _BINARY and not is_text and self._function and not self._is_default:
            self._add(node, ast.BinOp(node.left, _BINARY[type(node.op)](), node.right))
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        if isinstance(node.value, bool):
            self._add(node, ast.Constant(not node.value))
        elif isinstance(node.value, int):
            self._add(node, ast.Constant(node.value + 1))
        elif isinstance(node.value, float):
            self._add(node, ast.Constant(node.value * 2 + 1))

    def visit_If(self, node: ast.If | ast.While | ast.IfExp) -> None:
        if ast.unparse(node.test) == "TYPE_CHECKING":
            return
        if not isinstance(node.test, ast.Constant | ast.Compare):
            self._add(node.test, ast.UnaryOp(ast.Not(), node.test))
        self.generic_visit(node)

    visit_While = visit_If
    visit_IfExp = visit_If

    def visit_Expr(self, node: ast.Expr) -> None:
        call = node.value.value if isinstance(node.value, ast.Await) else node.value
        if not isinstance(call, ast.Call) or any(
            isinstance(one, ast.Name | ast.Attribute)
            and (one.id if isinstance(one, ast.Name) else one.attr) in _LOGGERS
            for one in ast.walk(call.func)
        ):
            return
        self._add(node, ast.Pass())
        self.generic_visit(node)

    def visit_Raise(self, node: ast.Raise) -> None:
        self._add(node, ast.Pass())  # what it says is not changed: texts are for people

    def visit_Return(self, node: ast.Return) -> None:
        if node.value is not None and not (isinstance(node.value, ast.Constant) and not node.value.value):
            # Not `return False`: who asks whether it is true sees no difference to None.
            self._add(node, ast.Return(ast.Constant(None)))
        self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        if type(node.op) in _BINARY:
            self._add(node, ast.AugAssign(node.target, _BINARY[type(node.op)](), node.value))
        self.generic_visit(node)

    def visit_Break(self, node: ast.Break) -> None:
        self._add(node, ast.Continue())

    def visit_Continue(self, node: ast.Continue) -> None:
        self._add(node, ast.Break())

    def _add(self, old: ast.expr | ast.stmt, new: ast.AST) -> None:
        assert old.end_lineno is not None
        assert old.end_col_offset is not None
        begin = self._starts[old.lineno - 1] + old.col_offset
        end = self._starts[old.end_lineno - 1] + old.end_col_offset
        text = ast.unparse(ast.fix_missing_locations(new))
        if isinstance(old, ast.expr):
            text = f"({text})"
        was = self._source[begin:end].decode()
        name = "" if self._function else self._assigned
        self.found.append(Change(self._path, self._function, name, old.lineno, begin, end, was, text))


def _short(text: str) -> str:
    words = " ".join(text.split())
    return f"`{words[:70]}...`" if len(words) > 73 else f"`{words}`"
