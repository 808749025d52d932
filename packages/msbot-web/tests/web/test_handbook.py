"""The handbook on the page: every page is there, every link leads somewhere."""

from __future__ import annotations

import re

import pytest

from msbot_web import handbook
from msbot_web.pages.menu import MENU
from msbot_web.pages.page_help import HELP

PAGES = [name for chapter in handbook.chapters() for name, _ in chapter.pages]


def test_every_chapter_has_its_pages_with_their_titles() -> None:
    titles = {chapter.title: dict(chapter.pages) for chapter in handbook.chapters()}
    assert list(titles) == ["Tutorial", "How to", "Explanation", "Reference", "Evidence", "Decisions"]
    assert titles["How to"]["howto/swap_a_part"] == "Swap a part"


@pytest.mark.parametrize("name", PAGES)
def test_every_link_and_picture_of_a_page_leads_somewhere(name: str) -> None:
    html = handbook.page_html(name)
    assert html is not None
    for path in re.findall(r'(?:href|src)="/handbook/([^"#]+)', html):
        if path.startswith("pictures/"):
            assert handbook.picture(path.removeprefix("pictures/")) is not None, path
        elif path.startswith(tuple(f"{folder}/" for folder, _ in handbook.CHAPTERS)) and not path.endswith("/"):
            assert path in PAGES, path


@pytest.mark.parametrize("name", ["", "nothing", "../README", "howto/../howto/keys", "/etc/hostname"])
def test_nothing_but_the_handbook_is_read(name: str) -> None:
    assert handbook.page_html(name) is None
    assert handbook.picture(name) is None


def test_every_page_of_the_menu_has_help_in_three_sentences_that_leads_on() -> None:
    for way in MENU:
        assert len(re.findall(r"[.!?](?: |$)", HELP[way.path].words)) == 3, way.path
        assert HELP[way.path].page in PAGES
