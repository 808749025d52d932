"""The docs say what there is: links lead somewhere, and no page is left out."""

import importlib
import re
from pathlib import Path

import pytest

from tools.docs_site import FACES, FOR_EXTENSIONS
from tools.tab_site import FILES, missing_files, with_robot

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))


@pytest.mark.parametrize("page", [*PAGES, ROOT / "README.md", ROOT / "CONTRIBUTING.md"], ids=lambda page: page.name)
def test_every_link_leads_somewhere(page: Path) -> None:
    targets = re.findall(r"\]\((?!https?://|#)([^)#]+)(?:#[^)]*)?\)", page.read_text())
    missing = [target for target in targets if not (page.parent / target).exists()]
    assert not missing


@pytest.mark.parametrize("page", sorted((DOCS / "howto").glob("*.md")), ids=lambda page: page.name)
def test_a_guide_that_installs_msbot_says_where_it_comes_from(page: Path) -> None:
    """It is in no package index: `pip install 'msbot[serial]'` only adds to an environment that has it already."""
    words_and_code = page.read_text().split("```")
    blocks = zip(words_and_code[::2], words_and_code[1::2], strict=False)
    unsaid = [code for words, code in blocks if "pip install 'msbot[" in code and "](install.md)" not in words]
    assert not unsaid


def test_every_page_is_in_the_navigation() -> None:
    navigation = (ROOT / "mkdocs.yml").read_text()
    assert [str(page.relative_to(DOCS)) for page in PAGES if str(page.relative_to(DOCS)) not in navigation] == []
    listed = re.findall(r": (\S+\.md)$", navigation, re.MULTILINE)
    assert [name for name in listed if not (DOCS / name).exists()] == []


def test_the_readme_shows_the_examples_as_they_are() -> None:
    readme = (ROOT / "README.md").read_text()
    shown = re.findall(r"`(examples/\w+\.py)`:\n\n```python\n(.*?)```", readme, re.DOTALL)
    assert len(shown) == 3
    for name, code in shown:
        assert code.strip() == (ROOT / name).read_text().strip()


def test_the_robot_in_a_tab_has_its_place_on_its_page() -> None:
    page = with_robot((DOCS / "tutorial/try_in_this_tab.md").read_text(), 13_900_000)
    assert '<div id="tab-robot" data-megabytes="14">' in page
    assert all(f'"{file}"' in page for file in FILES)
    with pytest.raises(ValueError, match="for the robot"):
        with_robot("# A page without a robot", 1)


def test_a_site_whose_page_does_not_find_its_files_is_noticed(tmp_path: Path) -> None:
    page = tmp_path / "tutorial" / "page" / "index.html"
    page.parent.mkdir(parents=True)
    (tmp_path / "tab").mkdir()
    for file in FILES:
        (tmp_path / "tab" / Path(file).name).touch()
    page.write_text('<link href="../../tab/tab.css"><script src="../../tab/tab.js"></script>')
    assert missing_files(page) == []
    page.write_text('<link href="../../../tab/tab.css"><script src="../../tab/tab.js"></script>')
    assert missing_files(page) == ["../../../tab/tab.css"]
    page.write_text("a page without them")
    assert missing_files(page) == [*FILES]


def test_the_site_has_each_class_that_an_extension_is_made_of() -> None:
    page = (DOCS / "howto/write_an_extension.md").read_text()
    named = re.findall(r"a `(msbot[\w.]*)\.([A-Z]\w+)`", page)
    assert len(named) >= 8
    known = {(face, name) for face in FACES | FOR_EXTENSIONS for name in importlib.import_module(face).__all__}
    assert [f"{face}.{name}" for face, name in named if (face, name) not in known] == []


def words(*pages: Path) -> int:
    """What `wc -w` counts: all between blanks, also the bars of tables, marks of lists, programs and their output."""
    return sum(len(page.read_text().split()) for page in pages)


def test_the_pages_stay_short() -> None:
    assert words(*PAGES) <= 80_000
    assert words(ROOT / "CONTRIBUTING.md") <= 1500
    assert [page.name for page in (DOCS / "explain").glob("*.md") if words(page) > 1500] == []
    assert len((ROOT / "README.md").read_text().splitlines()) <= 120
    assert len((ROOT / "CHANGELOG.md").read_text().splitlines()) <= 60
