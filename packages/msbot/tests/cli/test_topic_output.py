"""What `msbot topic` prints: messages in every form, rates, and what people may type for a message."""

from __future__ import annotations

import csv
import json
from typing import Any

import pytest

from msbot.cli.topic.message_output import MessageOutput, TimeForm
from msbot.cli.topic.rates import MessageWindow
from msbot.cli.topic.topic_commands import _type_and_values
from msbot_xrce.errors import ConfigError

POSE: dict[str, Any] = {
    "name": "a, b",
    "at": {"x": 1.5, "y": float(2)},
    "scan": [1, 2],
    "ok": True,
    "none": [],
    "ways": [{"to": "door", "far": 49.900001525878906}],
}


def told(fields: object, **options: Any) -> list[str]:
    return list(MessageOutput("pose", **options).lines({"at": 12.25, "slot": "eye", "fields": fields}))


def test_a_message_is_yaml_that_yaml_reads_back() -> None:
    yaml = pytest.importorskip("yaml", reason="PyYAML reads what is printed")
    lines = told(POSE)
    assert lines[-1] == "---"
    read = yaml.safe_load("\n".join(lines[:-1]))
    assert read == {**POSE, "ways": [{"to": "door", "far": 49.9}]}
    for text in ("", "true", "12", "- x", "a: b", "line\nbreak", "\x1b[31mred", "#", "ends:", " blank "):
        line = told({"text": text})[0]
        assert line.isprintable()
        assert yaml.safe_load(line) == {"text": text}


def test_a_line_for_each_message() -> None:
    assert told(POSE, as_csv=True) == ['"a, b",1.5,2.0,1,2,true,door,49.9']
    assert next(csv.reader(told({"formula": "=1+1"}, as_csv=True))) == ["'=1+1"]
    found = json.loads(told(POSE, as_json=True)[0])
    assert found == {"at": 12.25, "topic": "pose", "slot": "eye", "fields": POSE}
    assert told(POSE, field="at.x", as_csv=True) == ["1.5"]
    with pytest.raises(ConfigError, match=r"no field .at\.z.; it has x, y"):
        told(POSE, field="at.z")


def test_times_are_those_of_candump() -> None:
    for form, lines in {
        TimeForm.ABSOLUTE: [" (100.500000)  t  v 1", " (100.750000)  t  v 2", " (102.000000)  t  v 3"],
        TimeForm.DELTA: [" (000.000000)  t  v 1", " (000.250000)  t  v 2", " (001.250000)  t  v 3"],
        TimeForm.ZERO: [" (000.000000)  t  v 1", " (000.250000)  t  v 2", " (001.500000)  t  v 3"],
    }.items():
        output = MessageOutput("t", times=form)
        seen = zip((100.5, 100.75, 102.0), (1, 2, 3), strict=True)
        assert [line for at, v in seen for line in output.lines({"at": at, "fields": {"v": v}})] == lines


def test_rates_are_of_the_newest_messages() -> None:
    seen = MessageWindow(4)
    assert (seen.rate, seen.bandwidth(0.0)) == (None, None)
    seen.add(0.0, 5)
    assert seen.rate is None
    for at, octets in ((9.0, 100), (9.5, 100), (10.0, 200), (11.0, 400)):
        seen.add(at, octets)
    rate, band = seen.rate, seen.bandwidth(11.0)
    assert rate is not None
    assert band is not None
    assert rate.describe == "average rate: 1.500\n\tmin: 0.500s max: 1.000s std dev: 0.23570s window: 4"
    assert band.describe == "400 B/s from 4 messages\n\tMessage size mean: 200 B min: 100 B max: 400 B"
    assert (rate.as_json()["hz"], band.as_json()["octets_per_s"]) == (1.5, 400.0)


def test_a_message_may_be_typed_as_in_ros() -> None:
    level = {"type": "Level", "free": False, "fields": [["percent", "float32"]]}
    assert _type_and_values(level, ("40",)) == (None, ["40"])
    assert _type_and_values(level, ("msbot/msg/Level", "{percent: 40}")) == ("Level", ["percent=40"])
    assert _type_and_values(level, ("-40",)) == (None, ["-40"])
    assert _type_and_values({"type": "", "free": True, "fields": []}, ("HelloWorld", "1", "hi")) == (
        "HelloWorld",
        ["1", "hi"],
    )
    assert _type_and_values(level, ("std_msgs/msg/Float32", "{data: 40}")) == ("Float32", ["data=40"])
    assert _type_and_values(level, ("percent: 40",)) == (None, ["percent=40"])


def test_a_field_of_a_list_is_chosen_by_its_place_as_it_is_printed() -> None:
    assert told(POSE, field="scan[1]")[0] == "2"
    assert told(POSE, field="ways[0].to")[0] == "door"
    with pytest.raises(ConfigError, match=r"has no 'scan\[2\]'; it has 2 elements there"):
        told(POSE, field="scan[2]")
    with pytest.raises(ConfigError, match=r"has no 'name\[0\]'; that is no list"):
        told(POSE, field="name[0]")


def test_a_type_without_values_is_said() -> None:
    meant = {"topic": "t", "type": "Number", "free": False, "fields": [["value", "float32"]]}
    with pytest.raises(ConfigError, match=r"t: the values are missing behind Number: value \(float32\)"):
        _type_and_values(meant, ("Number",))
