"""The templates of devices: what is understood, what is not, and that each takes bounded time."""

from __future__ import annotations

import pytest

from msbot_bridges.mqtt.template import Template
from msbot_xrce.errors import ConfigError


@pytest.mark.parametrize(
    ("template", "payload", "made"),
    [
        ("", "17", "17"),
        ("{{ value }}", "17", "17"),
        ("{{value_json.temperature}}", '{"temperature": 21.5}', "21.5"),
        ("{{ value_json['a']['b'][1] }}", '{"a": {"b": [1, 2]}}', "2"),
        ("{{ value_json.a.b | float * 2 }}", '{"a": {"b": "4"}}', "8.0"),
        ("{{ (value | float / 3) | round(2) }}", "10", "3.33"),
        ("{{ value | int }}", "3.9", "3"),
        ("{{ 'ON' if value_json.on else 'OFF' }}", '{"on": false}', "OFF"),
        ("{{ value_json.state == 'open' and value_json.n > 3 }}", '{"state": "open", "n": 4}', "True"),
        ("{{ value_json.gone | default('none') }}", "{}", "none"),
        ("{{ value_json.gone | default(0) | int }}", "no json", "0"),
        ("level {{ value }} %", "5", "level 5 %"),
        ("{{ value_json.x }}", "[]", None),
        ("{{ value_json.x }}", "no json", None),
        ("{{ value_json.x / 0 }}", '{"x": 1}', None),
        ("{{ not value_json.x }}", '{"x": 0}', "True"),
        ("{{ value | upper ~ '!' }}", "on", "ON!"),
        ("{{ -value_json.x }}", '{"x": 2}', "-2"),
    ],
)
def test_a_template_takes_a_value_out_of_a_payload(template: str, payload: str, made: str | None) -> None:
    assert Template(template).render(payload) == made


@pytest.mark.parametrize(
    "template",
    [
        "{% for x in range(9) %}{{ x }}{% endfor %}",
        "{{ states('light.x') }}",
        "{{ value",
        "{{ value.__class__ | attr('x') }}",
        "{{ value | shell }}",
        "{{ 2 ** 99 }}",
        "{{ ; }}",
        "{{ " + "(" * 100 + "1" + ")" * 100 + " }}",
        "{{ " + "value ~ " * 100 + "value }}",
    ],
)
def test_what_is_not_understood_is_said_when_it_is_read(template: str) -> None:
    with pytest.raises(ConfigError, match="template"):
        Template(template)


@pytest.mark.parametrize("template", ["{{ 'x' * 1000000 }}", "{{ value ~ value }}", "{{ value_json * 9 }}"])
def test_nothing_grows_without_bound(template: str) -> None:
    assert Template(template).render("y" * 9000) is None


def test_only_what_is_in_the_payload_is_reached() -> None:
    assert Template("{{ value.__class__ }}").render("x") is None
    assert Template("{{ value_json.x.upper }}").render('{"x": "y"}') is None
