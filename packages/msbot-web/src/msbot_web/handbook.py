"""The handbook: the project's documentation as pages of the robot itself, without the internet."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path, PurePosixPath

from msbot.carried.carried_files import carried_folder
from msbot_web.root_path import root
from msbot_xrce.lazy import dataclass

CHAPTERS = (
    ("tutorial", "Tutorial"),
    ("howto", "How to"),
    ("explain", "Explanation"),
    ("reference", "Reference"),
    ("evidence", "Evidence"),
    ("decisions", "Decisions"),
)
"""Folders of the handbook with their titles, in the order of reading."""
FOR_PUPILS = (
    "tutorial/first_part",
    "tutorial/own_part",
    "howto/program_in_the_browser",
    "howto/blocks",
    "howto/arena",
    "howto/missions",
    "howto/plots",
)
"""What somebody who learns reads first."""
PICTURES = {".png": "image/png", ".svg": "image/svg+xml"}
"""What a page of the handbook may show besides text: endings and media types."""
_HEADING = re.compile(r"<h1[^>]*>.*?</h1>", re.DOTALL)
_TARGET = re.compile(r'(?P<what>href|src)="(?P<path>[^":#]+)(?P<anchor>#[^"]*)?"')


@dataclass(frozen=True, slots=True)
class Chapter:
    """One folder of the handbook."""

    title: str
    pages: tuple[tuple[str, str], ...]
    """`(name, title)` of each page; the name is its path without `.md`, for example `howto/swap_a_part`."""


def folder() -> Path:
    """Where the handbook is: in the installed package, or `docs` of a checkout."""
    return carried_folder(Path(__file__).parent, "docs", "docs")


@cache
def chapters() -> tuple[Chapter, ...]:
    """Every page of the handbook, in the order of reading."""
    found = []
    for name, title in CHAPTERS:
        pages = sorted((folder() / name).glob("*.md"))
        found.append(Chapter(title, tuple((f"{name}/{page.stem}", _title(page)) for page in pages)))
    return tuple(found)


def handbook_names(*folders: str) -> list[str]:
    """The names of the pages of these chapters."""
    return [name for name in _titles() if name.partition("/")[0] in folders]


def title_of(name: str) -> str | None:
    """The title of a page of the handbook; None when there is none of that name."""
    return _titles().get(name)


@cache
def _titles() -> dict[str, str]:
    return dict(page for chapter in chapters() for page in chapter.pages)


def page_html(name: str) -> str | None:
    """A page of the handbook as HTML without its title, its links led to the other pages; None when there is none."""
    return _page_html(name, root())


@cache
def _page_html(name: str, where: str) -> str | None:
    if title_of(name) is None:
        return None
    text = (folder() / f"{name}.md").read_text("utf-8")
    import markdown2  # only who reads the handbook needs it

    html = str(markdown2.markdown(text, extras=["fenced-code-blocks", "tables", "header-ids"]))
    return _TARGET.sub(lambda found: _led(name, where, found), _HEADING.sub("", html, count=1))


def picture(name: str) -> tuple[bytes, str] | None:
    """A picture of the handbook and its media type; None when there is none of that name."""
    known = {str(path.relative_to(folder()).as_posix()) for ending in PICTURES for path in folder().rglob(f"*{ending}")}
    if name not in known:
        return None
    path = folder() / name
    return path.read_bytes(), PICTURES[path.suffix]


def _title(page: Path) -> str:
    with page.open(encoding="utf-8") as lines:
        return lines.readline().rstrip("\n").removeprefix("# ").replace("`", "")


def _led(name: str, root: str, found: re.Match[str]) -> str:
    parts: list[str] = []
    for part in (PurePosixPath(name).parent / found["path"]).parts:
        if part == "..":
            parts[-1:] = []
        else:
            parts.append(part)
    target = "/".join(parts).removesuffix(".md")
    is_picture = PurePosixPath(target).suffix in PICTURES
    where = "/handbook/pictures/" if is_picture else "/handbook/"
    return f'{found["what"]}="{root}{where}{target}{found["anchor"] or ""}"'
