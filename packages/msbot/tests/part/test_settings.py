"""Settings: read with a type, followed while they change, safe values taken out."""

from __future__ import annotations

import logging

import pytest

from msbot.part.handler_guard import Guard
from msbot.part.join.pnp_messages import Setting
from msbot.part.part_settings import DeclaredSettings, Settings, Value, read_value
from msbot.part.program import ProgramDeclarations
from msbot.process.virtual_time import run_virtual
from msbot_xrce.errors import ConfigError


def listed(**texts: str) -> list[Setting]:
    return [Setting(name=name, value=value) for name, value in texts.items()]


def taken(**texts: str) -> Settings:
    settings = Settings(Guard(lambda _: None), DeclaredSettings())
    settings.take(listed(**texts))
    return settings


def test_a_setting_is_read_with_its_type() -> None:
    settings = taken(period_s="0.5", count="3", loud="true", title="one two")
    assert settings.value("period_s", float) == 0.5
    assert settings.value("count", int) == 3
    assert settings.value("count", float) == 3.0
    assert settings.value("loud", bool) is True
    assert settings.value("title", str) == "one two"
    assert dict(settings.texts) == {"period_s": "0.5", "count": "3", "loud": "true", "title": "one two"}


def test_a_setting_that_is_not_there_has_its_default_or_names_the_others() -> None:
    settings = taken(count="3")
    assert settings.value("other", int, 7) == 7
    with pytest.raises(ConfigError, match="no setting 'other' in this robot; it sets: count"):
        settings.value("other", int)
    with pytest.raises(ConfigError, match="it sets: none"):
        taken().value("other", int)


@pytest.mark.parametrize(("text", "kind"), [("fast", float), ("1.5", int), ("yes", bool), ("True", bool)])
def test_a_text_of_another_kind_is_an_error_that_says_so(text: str, kind: type[Value]) -> None:
    with pytest.raises(ConfigError, match=f"setting 'x' is '{text}', which is not "):
        read_value("x", text, kind)


def test_only_four_kinds_can_be_asked_for() -> None:
    settings = taken(x="1")
    with pytest.raises(ConfigError, match="bool, int, float or str"):
        settings.value("x", bytes)  # type: ignore[type-var]  # that is the point
    with pytest.raises(ConfigError, match="bool, int, float or str"):
        ProgramDeclarations().settings.follow("x", list, print)  # type: ignore[type-var]  # that is the point


def test_functions_hear_what_is_new_or_has_changed_and_nothing_else() -> None:
    async def main() -> None:
        program = ProgramDeclarations()
        settings = Settings(Guard(lambda _: None), program.settings)
        heard: list[Value] = []
        program.settings.follow("count", int, heard.append)
        program.settings.follow("loud", bool, heard.append)
        settings.take(listed(count="1", loud="false"))
        settings.tell()
        assert heard == [1, False]
        settings.tell()
        settings.take(listed(count="2", loud="false"))
        settings.tell()
        assert heard == [1, False, 2]
        settings.forget()
        assert dict(settings.texts) == {}
        settings.take(listed(count="2", loud="false"))
        settings.tell()
        assert heard == [1, False, 2, 2, False]

    run_virtual(main())


def test_a_value_that_cannot_be_read_is_reported_once_and_not_told(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        program = ProgramDeclarations()
        settings = Settings(Guard(lambda _: None), program.settings)
        heard: list[Value] = []
        program.settings.follow("count", int, heard.append)
        program.settings.follow("other", int, heard.append)
        for _ in range(2):
            settings.take(listed(count="many"))
            settings.tell()
            settings.forget()
        assert heard == []

    with caplog.at_level(logging.ERROR):
        run_virtual(main())
    assert [record.getMessage() for record in caplog.records] == [
        "setting 'count': setting 'count' is 'many', which is not a whole number",
        "setting 'other': this robot does not set it",
    ]


def test_safe_values_are_no_settings() -> None:
    settings = Settings(Guard(lambda _: None), DeclaredSettings())
    safe = settings.take([Setting(name="speed.safe.value", value="0"), Setting(name="speed", value="1")])
    assert safe == {"speed.safe.value": "0"}
    assert dict(settings.texts) == {"speed": "1"}
