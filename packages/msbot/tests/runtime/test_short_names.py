"""Short names keep what a package does, and what programs may write."""

from __future__ import annotations

import ast
import re

from msbot.carried.carried_files import board_sources, shortened, with_short_names

SOURCES = {
    "base": """
from micropython import const

SIZE = const(0x10)
OPEN = const(3)

def scale(amount, by=2):
    return amount * by

class Base:
    shown = "shown"

    def __init__(self, first):
        self._first = first
        self.first = _doubled(first)

    def _told(self):
        return self._first, self.first

def _doubled(value):
    return 2 * value
""",
    "tip": """
from . import base
from .base import SIZE, Base, scale

class Tip(Base):
    def __init__(self, first, second):
        super().__init__(first)
        self._second = second

    def told(self, values):
        try:
            shown = [self._second + value for value in values] + [len(values) + SIZE, base.OPEN]
        except TypeError as values:
            return str(values)
        return self._told(), shown, (lambda values: values)(4), self.shown

    def open(self, port, message, *, safe=None):
        def remember(function):
            function(port, message, safe)
            return function
        return remember

def use(what):
    return scale(3, by=what), hasattr(Tip(1, 2), "_second")
""",
}


def run(sources: dict[str, str]) -> list[object]:
    """What the two modules say of themselves."""
    spaces: dict[str, dict[str, object]] = {name: {"const": int} for name in sources}
    base = re.sub(r"(?m)^from \S* import .*\n", "", sources["base"])
    exec(base, spaces["base"])
    spaces["tip"].update(spaces["base"], base=type("base", (), spaces["base"]))
    exec(re.sub(r"(?m)^from \S* import .*\n", "", sources["tip"]), spaces["tip"])
    tip = spaces["tip"]["Tip"](1, 20)  # type: ignore[operator]
    heard: list[object] = []
    tip.open(port="in", message="m", safe=5)(lambda *values: heard.extend(values))
    return [tip.told([1, 2]), tip.told(7), heard, spaces["tip"]["use"](5)]  # type: ignore[operator]


def test_a_package_with_short_names_does_the_same() -> None:
    short = with_short_names(SOURCES, {"Tip"})
    assert run(short) == run(SOURCES)
    together = "\n".join(short.values())
    for name in ("_first", "_told", "_doubled", "amount", "what"):
        assert not re.search(rf"\b{name}\b", together), name
    for name in ("_second", "by", "port", "message", "safe", "shown", "OPEN"):  # a text, passed by name, of programs
        assert re.search(rf"\b{name}\b", together), name
    assert "SIZE" not in short["tip"]
    assert "16" in short["tip"]


def test_what_programs_call_keeps_its_arguments() -> None:
    """All that the package offers by name, and the verbs of a part."""
    short = shortened()
    for module, names in {
        "part": ("Part", "setting", "publish", "bound"),
        "declaring": ("every", "on", "on_setting", "publishes"),
        "membership": ("ExpectedRobot",),
        "message": ("field",),
        "gpio": ("SimGpio",),
        "errors": ("listen",),
        "running": ("start", "use_host"),
        "generic": ("run_board",),
    }.items():
        before = arguments_of((board_sources() / f"{module}.py").read_text(), names)
        assert before
        assert arguments_of(short[module], names) == before


def arguments_of(text: str, names: tuple[str, ...]) -> list[tuple[str, str]]:
    """Of the functions with these names, and of what makes an object of the classes."""
    found = []
    for node in ast.walk(ast.parse(text)):
        inner = node.body if isinstance(node, ast.ClassDef) and node.name in names else []
        makers = [each for each in inner if isinstance(each, ast.FunctionDef) and each.name == "__init__"]
        functions = [node] if isinstance(node, ast.FunctionDef) and node.name in names else makers
        found += [(getattr(node, "name", ""), ast.unparse(each.args)) for each in functions]
    return found
