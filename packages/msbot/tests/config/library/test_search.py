"""Finding part types by words."""

import pytest

from msbot.config import PartType, load_library
from msbot.config.library.search import PartSearch

SEARCH = PartSearch(load_library())


@pytest.mark.parametrize(
    ("query", "first"),
    [
        ("SG90", "SG90"),
        ("sg90", "SG90"),
        ("hcsr04", "HC-SR04"),
        ("joystick", "KY-023"),
        ("strong servo", "MG996R"),
        ("gps", "NEO-6M"),
        ("barometer", "BMP280"),
        ("ultrasonic range", "HC-SR04"),
        ("emergency stop", "ESTOP"),
        ("numato gpio", "NUMATO-8"),
        ("thesis light", "ABCD"),
    ],
)
def test_the_best_one_comes_first(query: str, first: str) -> None:
    assert SEARCH.find(query)[0].number == first


def test_every_word_must_be_found() -> None:
    assert SEARCH.find("servo gps") == []
    assert SEARCH.find("") == []
    both = {part_type.number for part_type in SEARCH.find("temperature")}
    assert {"DHT22", "DS18B20", "BMP280"} <= both


def test_beginnings_and_slips_of_the_pen() -> None:
    assert "HC-SR04" in [entry.number for entry in SEARCH.find("ultras")]
    assert "KY-023" in [entry.number for entry in SEARCH.find("joystik")]
    assert SEARCH.find("xq") == []


def test_whole_words_beat_beginnings_and_numbers_order_equals() -> None:
    search = PartSearch([PartType("B", "motor"), PartType("A", "motor"), PartType("C", "motorway")])
    assert [entry.number for entry in search.find("motor")] == ["A", "B", "C"]
    assert [entry.number for entry in search.find("motor", limit=1)] == ["A"]
