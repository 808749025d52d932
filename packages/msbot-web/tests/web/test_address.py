"""Everybody is addressed in one form, on all pages and in all lessons of a language."""

from __future__ import annotations

import re
from pathlib import Path

import polib
import pytest

from tests import ROOT

CATALOGUES = ROOT / "packages/msbot-web/src/msbot_web/languages"
LESSONS = ROOT / "lessons"
OTHER = {
    # Inside a sentence they are never "she", "they" and "their", which have a small letter there.
    "de": re.compile(r"(?<=[\wäöüß,»“”] )(Sie|Ihnen|Ihr(e|en|em|er|es)?)\b"),
    "fr": re.compile(r"\b(tu|toi|ton|tes)\b", re.IGNORECASE),
}
"""The form of address that a language does not use: German says du, French says vous."""


def texts_of(code: str) -> list[str]:
    """All that somebody reads in that language."""
    entries = polib.pofile(str(CATALOGUES / f"{code}.po"))
    found = [entry.msgstr for entry in entries]
    for folder in (LESSONS / code, LESSONS / f"{code}-simple"):
        found += [line for path in sorted(folder.glob("*.md")) for line in path.read_text().splitlines()]
    return found


@pytest.mark.parametrize("code", OTHER)
def test_one_form_of_address_is_used_everywhere(code: str) -> None:
    assert [text for text in texts_of(code) if OTHER[code].search(text)] == []


@pytest.mark.parametrize(
    ("text", "is_formal"),
    [
        ("W\u00e4hlen Sie einen Namen.", True),
        ("das ist nicht Ihr Zettel", True),
        ("was Ihnen geh\u00f6rt", True),
        ("Die Farbe sagt alles. Sie ist gr\u00fcn.", False),
        ("Zwei Teile: Ihre Namen stehen auf der Karte.", False),
        ("wie sie ihre Karten zeigen", False),
    ],
)
def test_the_other_form_is_found_in_german(text: str, is_formal: bool) -> None:
    assert bool(OTHER["de"].search(text)) == is_formal


def test_every_language_has_the_menus_of_the_blocks() -> None:
    folder = ROOT / "packages/msbot-web/src/msbot_web/static/blockly"
    for path in CATALOGUES.glob("*.po"):
        assert (folder / f"{path.stem}.js").is_file(), f"CONTRIBUTING.md, A language, says how: {path.stem}"
        assert f'"msg/{path.stem}.js"' in Path(folder / "manifest.json").read_text()
