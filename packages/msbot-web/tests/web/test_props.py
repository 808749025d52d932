"""What a stranger has named never becomes a property of an element: NiceGUI runs those that begin with a colon.

`props("...")` is read word by word, so a quotation mark in a text that is put into it begins another property, and one
such as `:title="..."` is a script. A text of a stranger is set by its key, `element.props["aria-label"] = text`.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

import msbot_web

OURS = re.compile(
    r"""(self\._page\.|page\.|self\.)?(?:say|translate)\((['"]).*\2\)|[A-Z_]+|'[\w-]+' if [\w.]+ else '[\w-]+'"""
)
"""A sentence of ours, a constant, one of two words."""
KNOWN = {("arena.py", "say(words)"), ("arena.py", "driven"), ("page_elements.py", "ending")}
"""What was looked at: it is written in the file itself."""
FILES = sorted(Path(str(msbot_web.__file__)).parent.rglob("*.py"))


@pytest.mark.parametrize("path", [path for path in FILES if ".props(" in path.read_text()], ids=lambda path: path.name)
def test_only_words_of_ours_are_put_into_properties(path: Path) -> None:
    strange = []
    for call in ast.walk(ast.parse(path.read_text())):
        if not (isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute) and call.func.attr == "props"):
            continue
        given = [*call.args, *(one.value for one in call.keywords)]
        for part in (part for one in given for part in ast.walk(one)):
            if isinstance(part, ast.FormattedValue):
                words = ast.unparse(part.value)
                if not OURS.fullmatch(words) and (path.name, words) not in KNOWN:
                    strange.append((call.lineno, words))
    assert strange == []
