"""Claims of the documentation that the code can hold: paths, modules, lengths, kinds of errors."""

import ast
import importlib
import re
from pathlib import Path

import pytest

import msbot_xrce.errors
from msbot.config import load_library
from msbot.part.join.pnp_messages import ClaimMessage
from msbot_agent.link.link_schemes import SCHEMES
from msbot_agent.startup.extensions import GROUPS, PREFIX
from tools import room_table
from tools.sources import source_files

ROOT = Path(__file__).parent.parent
PAGES = [*sorted((ROOT / "docs").rglob("*.md")), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
TOPS = ("packages", "tests", "bench", "fuzz", "tools", "examples", "firmware", "micropython")
SOURCES = {f"/{path.relative_to(ROOT).as_posix()}" for top in TOPS for path in (ROOT / top).rglob("*")}
"""Every file and folder, seen from the project."""
MADE = {"fuzz/findings"}
"""Folders that come into being when something runs."""
FILES = (".json", ".toml", ".db", ".py")
"""What looks like a name of the package and is a file of the reader."""


def test_the_library_has_as_many_part_types_as_the_pages_say() -> None:
    pages = [*PAGES, ROOT / "CHANGELOG.md"]
    said = {page: re.findall(r"\b(?:all|has|of) (\d+) part types\b", page.read_text()) for page in pages}
    told = {name: set(map(int, counts)) for name, counts in said.items() if counts}
    assert len(told) >= 3, "the counts are found at all"
    assert set().union(*told.values()) == {len(load_library().numbers())}, told


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_file_that_a_page_names_is_there(page: Path) -> None:
    named = set(re.findall(r"`([a-z0-9_/][A-Za-z0-9_/]*\.(?:py|sh|dbc|c|h))`", page.read_text()))
    if page.parent.name in ("howto", "tutorial"):
        named = {name for name in named if "/" in name}  # a bare name there is a file of the reader
    assert [name for name in sorted(named) if not is_in_the_project(name)] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_folder_that_a_page_names_is_there(page: Path) -> None:
    named = set(re.findall(r"`((?:packages|tests|bench|fuzz|tools|examples)(?:/[\w.]+)+)/?`", page.read_text()))
    assert [name for name in sorted(named - MADE) if not is_in_the_project(name)] == []


@pytest.mark.parametrize("page", [page for page in PAGES if page.name != "micropython.md"], ids=lambda page: page.name)
def test_every_name_in_the_package_that_a_page_uses_is_there(page: Path) -> None:
    named = set(re.findall(r"`(msbot(?:_xrce|_agent|_school|_web)?(?:\.[a-zA-Z_]\w*)+)`", page.read_text())) - {
        PREFIX + group for group in GROUPS
    }
    assert [name for name in sorted(named) if not name.endswith(FILES) and not is_there(name)] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_place_in_a_page_that_a_link_names_is_there(page: Path) -> None:
    missing = []
    for target, anchor in re.findall(r"\]\((?!https?://)([^)#]*)#([^)]+)\)", page.read_text()):
        there = page.parent / target if target else page
        if anchor not in anchors(there.read_text()):
            missing.append(f"{target}#{anchor}")
    assert missing == []


def test_the_table_of_rooms_is_made_from_the_contract() -> None:
    assert room_table.PAGE.read_text() == room_table.page(), "run `python tools/room_table.py`"


def test_callbacks_are_given_or_added_and_never_set_from_outside() -> None:
    """CONTRIBUTING's rule for callbacks."""
    set_outside = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for path in source_files()
        if ".on_" in (text := path.read_text())  # where no attribute is named so, none is set
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store) and node.attr.startswith("on_")
    ]
    assert set_outside == []


def test_every_kind_of_link_is_in_the_table_of_addresses() -> None:
    table = (ROOT / "docs/reference/links.md").read_text().partition("## Addresses")[2].partition("\n## ")[0]
    assert [scheme for scheme in SCHEMES if f"`{scheme}:" not in table] == []


def test_the_table_of_errors_has_all_of_its_file() -> None:
    listed = re.findall(r"[├└]── (\w+)", msbot_xrce.errors.__doc__ or "")
    classes = [
        name for name, value in vars(msbot_xrce.errors).items() if isinstance(value, type) and name != "MsbotError"
    ]
    assert sorted(listed) == sorted(classes)


def test_the_shortest_registration_is_as_long_as_the_decision_says() -> None:
    words = (ROOT / "docs/decisions/0002-inventory-service.md").read_text()
    shortest = len(ClaimMessage(part_number="", local_name="", uid=bytes(8), session_nonce=0).encode())
    assert f"shortest possible registration has {shortest} bytes" in words
    assert shortest > 16


def is_in_the_project(name: str) -> bool:
    """Whether there is a file or folder of that name, in any folder; NAME.py stands for whatever one calls it."""
    return re.search(r"(^|/)[A-Z]+\.\w+$", name) is not None or any(path.endswith(f"/{name}") for path in SOURCES)


def is_there(name: str) -> bool:
    """Whether a dotted name can be imported, or is an attribute of what can."""
    parts = name.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            found: object = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for attribute in parts[cut:]:
            if not hasattr(found, attribute):
                return False
            found = getattr(found, attribute)
        return True
    return False


def anchors(text: str) -> set[str]:
    """The anchors of a page's headings, as GitHub and the documentation site make them."""
    outside = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    heads = re.findall(r"^#+ (.+)$", outside, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).strip().replace(" ", "-") for head in heads}
