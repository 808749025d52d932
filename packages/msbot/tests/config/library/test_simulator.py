"""The values of a simulator: what a control takes."""

import pytest

from msbot.config import Control, ControlKind, Scalar
from msbot_xrce.errors import ConfigError

PRESS = Control("press", ControlKind.BOOL, False)
AIR = Control("air", ControlKind.NUMBER, 20.0, -40, 80, "°C")
FREE = Control("free", ControlKind.NUMBER, 0.0)
KEY = Control("key", ControlKind.CHOICE, "none", choices=("none", "A"))
WORDS = Control("words", ControlKind.TEXT, "")

PARSED: list[tuple[Control, str, Scalar]] = [
    (PRESS, "true", True),
    (PRESS, "Off", False),
    (PRESS, "1", True),
    (AIR, "-4.5", -4.5),
    (FREE, "1e6", 1e6),
    (KEY, "A", "A"),
    (WORDS, "1", "1"),
]


@pytest.mark.parametrize(("control", "text", "value"), PARSED)
def test_a_text_becomes_a_value(control: Control, text: str, value: Scalar) -> None:
    assert control.parse(text) == value


WRONG = [
    (PRESS, "maybe", 'control press must be true or false; it is the text "maybe"'),
    (AIR, "warm", 'control air must be a number, -40 to 80 °C; it is the text "warm"'),
    (AIR, "81", "control air is 81; it must be -40 to 80 °C"),
    (AIR, "nan", "control air is nan; it must be -40 to 80 °C"),
    (FREE, "inf", "control free is inf; it must be a finite number"),
    (FREE, "nan", "control free is nan; it must be a finite number"),
    (KEY, "B", 'control key must be one of none, A; it is the text "B"'),
]


@pytest.mark.parametrize(("control", "text", "sentence"), WRONG)
def test_a_text_that_is_no_value_is_explained(control: Control, text: str, sentence: str) -> None:
    with pytest.raises(ConfigError) as caught:
        control.parse(text)
    assert str(caught.value) == sentence


@pytest.mark.parametrize(("control", "value"), [(PRESS, 1), (AIR, True), (WORDS, 1), (KEY, False)])
def test_a_value_of_another_kind_is_wrong(control: Control, value: Scalar) -> None:
    assert control.fault(value) is not None
