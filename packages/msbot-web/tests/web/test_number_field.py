"""Fields for numbers: with a comma or a point, and clear about what is neither."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest
from nicegui import Client
from nicegui.page import page as nicegui_page

from msbot.operations.rights import Role
from msbot_web.language import languages
from msbot_web.models.robot_models import Value
from msbot_web.pages.number_field import NumberField
from msbot_web.pages.page import Page
from msbot_web.pages.parameter_form import _Form, _ParameterRow
from msbot_xrce.errors import ConfigError
from tests.web.rig import Rig, show


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("0,1", 0.1),
        ("0.1", 0.1),
        (" 12 ", 12),
        ("-3,25", -3.25),
        ("\N{MINUS SIGN}7", -7),
        ("+2", 2),
        (",5", 0.5),
        ("1.", 1.0),
        ("1e-3", 0.001),
        ("0,125", 0.125),
        ("0.125", 0.125),
        ("1,50", 1.5),
        ("1234,500", 1234.5),
    ],
)
@pytest.mark.parametrize("code", ["en", "de"])
def test_a_comma_is_a_point(code: str, text: str, number: float) -> None:
    assert languages()[code].read_number(text) == number


@pytest.mark.parametrize(
    "text",
    ["", "x", "1,000.5", "1.000,5", "0,1,2", "1 000", "--1", "1e999", "nan", "inf", "0x10", "1_0", "٣", "9" * 5000],
)
def test_what_is_no_number_is_refused(text: str) -> None:
    with pytest.raises(ConfigError) as refused:
        languages()["de"].read_number(text)
    words = languages()["de"].translate(str(refused.value))
    assert words.endswith("ist keine Zahl: schreibe 12 oder 0,1")
    assert len(words) < 120


@pytest.mark.parametrize(
    ("code", "text", "words"),
    [
        ("en", "1,000", "'1,000' may be 1000 or 1.0: write it in one of these ways"),
        ("en", " -12,500 ", "'-12,500' may be -12500 or -12.5: write it in one of these ways"),
        ("de", "1.000", "'1.000' kann 1000 oder 1,0 sein: schreibe es auf eine dieser Arten"),
    ],
)
@pytest.mark.parametrize("is_whole", [False, True])
def test_what_may_be_a_thousand_or_one_is_asked_for(code: str, text: str, words: str, is_whole: bool) -> None:
    with pytest.raises(ConfigError) as refused:
        languages()[code].read_number(text, is_whole=is_whole)
    assert languages()[code].translate(str(refused.value)) == words


@pytest.mark.parametrize("code", ["en", "de"])
def test_what_a_field_shows_it_reads(code: str) -> None:
    language = languages()[code]
    for number in (1.234, 12.5, 0.125, 999.001, -1.125):
        assert language.read_number(language.number(number, ".15g")) == number


def test_half_a_seed_is_refused() -> None:
    assert languages()["de"].read_number("12,0", is_whole=True) == 12
    with pytest.raises(ConfigError, match=r"^0\.5 is not a whole number$"):
        languages()["en"].read_number("0,5", is_whole=True)


def typed(field: NumberField, text: str) -> str | None:
    """Type a text, and leave the field; what is said under it."""
    field.value = text
    field.validate()
    return field.error


def test_a_field_takes_both_and_says_what_is_neither(tmp_path: Path) -> None:
    heard: list[float] = []

    async def scene(rig: Rig) -> None:
        with Client(nicegui_page("/")):
            page = Page(rig.service, rig.session(Role.TEACHER), languages()["de"])
            field = NumberField(page, "For [s]", number=2.5, on_number=heard.append)
            assert field.value == "2,5"
            assert typed(field, "0,1") is None
            assert typed(field, "0.25") is None
            assert typed(field, "0,1,2") == "'0,1,2' ist keine Zahl: schreibe 12 oder 0,1"
            assert field.number is None
            field.value = "7"  # while it is typed, before it is left
            assert field.error is None
            assert typed(field, "") is None
            assert field.number is None
            field.number = 1e-3
            assert field.value == "0,001"

    show(tmp_path, scene, parts=())
    assert heard == [0.1, 0.25, 7, 0.001]


async def _set(line: _ParameterRow, text: str) -> None:
    line._field.value = text
    await line._typed()


def test_a_setting_is_set_with_a_comma(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[Mapping[str, object]] = []

    async def act(_page: Page, _operation: str, **arguments: object) -> None:
        told.append(arguments)

    monkeypatch.setattr(Page, "act", act)

    async def scene(rig: Rig) -> None:
        with Client(nicegui_page("/")):
            page = Page(rig.service, rig.session(Role.TEACHER), languages()["de"])
            value = Value(name="gain", kind="float", value=1.5, default=1.0, least=0, most=2, origin="hand")
            line = _ParameterRow(_Form(page, "AA"), page, "AA", value)
            assert line._field.value == "1,5"
            await _set(line, "0,25")
            await _set(line, "0.5")
            await _set(line, "0,2,5")

    show(tmp_path, scene, parts=())
    assert [one["value"] for one in told] == [0.25, 0.5]
