"""The catalogue of words: complete, and with the same values in braces."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest
from starlette.requests import HTTPConnection

import msbot.web
from msbot.web.language import COOKIE, language_of, languages


def texts_of_the_pages() -> set[str]:
    """Every text that is handed to `say` as it stands, the titles of the menu, and the help."""
    found = set()
    for path in Path(str(msbot.web.__path__[0])).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if not isinstance(node, ast.Call):
                continue
            called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if called == "say" and node.args:
                found |= _strings(node.args[0])
            elif called == "Way":
                found |= _strings(node.args[2])
            elif called in ("PageHelp", "TourStep"):
                found |= _strings(node.args[0])
    for path in (Path(str(msbot.web.__path__[0])) / "templates").glob("*.html"):
        found |= set(re.findall(r'\bsay\("([^"]+)"', path.read_text()))
    return found


def _strings(node: ast.AST) -> set[str]:
    return {leaf.value for leaf in ast.walk(node) if isinstance(leaf, ast.Constant) and isinstance(leaf.value, str)}


OTHERS = [language for code, language in languages().items() if code != "en"]


def test_there_is_more_than_one_language() -> None:
    assert [language.name for language in OTHERS] == ["Deutsch"]


@pytest.mark.parametrize("code", [language.code for language in OTHERS])
def test_every_text_of_the_pages_is_translated(code: str) -> None:
    missing = texts_of_the_pages() - set(languages()[code].texts)
    assert missing == set()


@pytest.mark.parametrize("code", [language.code for language in OTHERS])
def test_translations_have_the_same_values(code: str) -> None:
    for english, text in languages()[code].texts.items():
        assert set(re.findall(r"{\w+}", text)) == set(re.findall(r"{\w+}", english)), english


def connection(accept: str = "", chosen: str = "") -> HTTPConnection:
    headers = [(b"accept-language", accept.encode())]
    if chosen:
        headers.append((b"cookie", f"{COOKIE}={chosen}".encode()))
    return HTTPConnection({"type": "http", "headers": headers})


@pytest.mark.parametrize(
    ("accept", "chosen", "code"),
    [
        ("", "", "en"), ("de-DE,de;q=0.9", "", "de"), ("fr,de;q=0.5", "", "de"), ("xx", "", "en"),
        ("de", "en", "en"), ("en", "de", "de"), ("de", "klingon", "de"), (";;,,-", "", "en"),
    ],
)  # fmt: skip
def test_the_language_follows_choice_then_browser_then_english(accept: str, chosen: str, code: str) -> None:
    assert language_of(connection(accept, chosen)).code == code


def test_what_is_not_translated_shows_in_english() -> None:
    german = languages()["de"]
    assert german.say("not in the catalogue {n}", n=3) == "not in the catalogue 3"
    assert german.say("Unplug {name}", name="BB") == "BB ausstecken"
