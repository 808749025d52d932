"""docs/reference/words.md and the code: one word for one thing."""

import ast
import re
from collections import defaultdict
from functools import cache
from pathlib import Path

from tools.sources import dotted, source_files

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "docs/reference/words.md").read_text()


@cache
def rooms_of_classes() -> dict[str, set[str]]:
    """Public class -> the rooms that define one of that name."""
    rooms = defaultdict(set)
    for path in source_files():
        package, *rest = dotted(path).split(".")
        room = {"msbot_xrce": "xrce", "msbot_web": "web"}.get(package) or (rest[0] if rest else package)
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                rooms[node.name].add(room)
    return dict(rooms)


def shared_on_purpose() -> dict[str, set[str]]:
    """What the table of words.md allows, with the rooms it names."""
    table = PAGE.partition("| class | rooms | why |")[2]
    allowed = {}
    for row in re.findall(r"^\| (`.+?`) \| (`.+?`) \| (.+?) \|$", table, re.MULTILINE):
        for name in re.findall(r"`(\w+)`", row[0]):
            allowed[name] = set(re.findall(r"`(\w+)`", row[1]))
    return allowed


def test_no_class_name_means_two_things_in_two_rooms() -> None:
    double = {name: rooms for name, rooms in rooms_of_classes().items() if len(rooms) > 1}
    known = shared_on_purpose()
    new = {name: rooms for name, rooms in double.items() if not rooms <= known.get(name, set())}
    assert new == {}, "give these classes names of their own, or a line with the reason in docs/reference/words.md"


def test_names_shared_on_purpose_are_there() -> None:
    rooms = rooms_of_classes()
    assert shared_on_purpose()
    assert {name: said for name, said in shared_on_purpose().items() if said != rooms.get(name)} == {}


def test_every_word_is_explained_once() -> None:
    table = PAGE.partition("| word | means |")[2].partition("\n## ")[0]
    words = [word.strip() for row in re.findall(r"^\| ([^|-][^|]*) \|", table, re.MULTILINE) for word in row.split(",")]
    assert len(words) > 40
    assert sorted({word for word in words if words.count(word) > 1}) == []
