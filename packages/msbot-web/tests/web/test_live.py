"""Live values: what is on a topic, how often, and its past; octets of any kind are shown and break nothing."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot.part import HelloWorld, Message
from msbot.part.messages.wire_types import float64
from msbot_agent.space import MemorySpace, Qos, Topic, Writer
from msbot_web.live_values import LONGEST_TEXT, MOST_KEPT_IN_ALL, SPARK_POINTS, LiveValues, _SampleHistory
from msbot_web.recorded_snapshot import spark_of
from msbot_web.svg.drawings import draw
from tests.web.access.test_accounts import Clock


class Place(Message):
    x: float64
    name: str


class Switch(Message):
    name: str
    on: bool


class Dimmer(Message):
    on: bool
    level: float64


class Everything(Message):
    place: Place
    places: list[Place]
    numbers: list[float64]
    raw: bytes
    far: float64
    on: bool


GUID = bytes(16)
KNOWN: dict[str, type[Message]] = {
    "HelloWorld": HelloWorld,
    "Everything": Everything,
    "Switch": Switch,
    "Dimmer": Dimmer,
}


class Rig:
    def __init__(self) -> None:
        self.clock = Clock()
        self.space = MemorySpace()
        self.live = LiveValues(self.space, KNOWN.get, self.clock)

    def writer(self, topic: str, type_name: str = "HelloWorld") -> Writer:
        return self.space.writer(Topic(topic, type_name), Qos(reliable=False), GUID)

    def fields(self, topic: str) -> dict[str, object]:
        watch = self.live.topic(topic)
        assert watch is not None
        return dict(self.live.fields(watch))


def hello(index: int, text: str = "hi") -> bytes:
    return HelloWorld(index=index, message=text).encode()


def test_the_latest_value_its_count_and_its_age() -> None:
    rig = Rig()
    rig.live.watch({"a": "HelloWorld"})
    assert rig.fields("a") == {}
    writer = rig.writer("a")
    for index in range(3):
        rig.clock.now = float(index)
        writer.write(hello(index))
    watch = rig.live.topic("a")
    assert watch is not None
    assert (watch.count, watch.at) == (3, 2.0)
    assert rig.fields("a") == {"index": 2, "message": "hi"}


def test_of_a_service_its_requests_are_counted() -> None:
    rig = Rig()
    rig.live.watch({"photo": "HelloWorld -> Switch"})
    requests = rig.space.writer(Topic("photo_Request", "HelloWorld"), Qos(service=True), GUID)
    rig.writer("photo", "HelloWorld -> Switch").write(b"of nobody")
    requests.write(hello(1))
    watch = rig.live.topic("photo")
    assert watch is not None
    assert watch.count == 1
    assert rig.fields("photo") == {"index": 1, "message": "hi"}


def test_a_switch_has_a_small_curve_of_ones_and_zeroes_and_a_number_goes_before_it() -> None:
    rig = Rig()
    rig.live.watch({"s": "Switch", "d": "Dimmer"})
    switch, dimmer = rig.writer("s", "Switch"), rig.writer("d", "Dimmer")
    for second in range(4):
        rig.clock.now = second * 2.0
        switch.write(Switch(name="lamp", on=second % 2 == 1).encode())
        dimmer.write(Dimmer(on=True, level=second / 2).encode())
        curves = {topic: spark_of(rig.live, topic) for topic in ("s", "d")}
    assert curves == {"s": [0.0, 1.0, 0.0, 1.0], "d": [0.0, 0.5, 1.0, 1.5]}


def test_only_the_topics_that_are_watched_are_listened_to() -> None:
    rig = Rig()
    rig.live.watch({"a": "HelloWorld", "b": "HelloWorld"})
    first = rig.live.topic("a")
    rig.live.watch({"a": "HelloWorld", "c": "HelloWorld"})
    assert rig.live.topic("a") is first
    assert rig.live.topic("b") is None
    rig.live.watch({"a": "Everything"})
    assert rig.live.topic("a") is not first
    rig.live.close()
    assert rig.live.topic("a") is None
    rig.writer("a").write(hello(1))
    assert first is not None
    assert first.count == 0


@pytest.mark.parametrize(("period_s", "hz"), [(0.02, 50.0), (0.5, 2.0), (1.0, 1.0)])
def test_the_rate_is_that_of_the_last_seconds(period_s: float, hz: float) -> None:
    rig = Rig()
    rig.live.watch({"a": "HelloWorld"})
    writer = rig.writer("a")
    for index in range(int(10 / period_s)):
        rig.clock.now = index * period_s
        writer.write(hello(index))
    watch = rig.live.topic("a")
    assert watch is not None
    assert watch.rate_hz(rig.clock.now) == pytest.approx(hz, rel=0.05)
    assert watch.rate_hz(rig.clock.now + 2.0) < hz * 0.8
    assert watch.rate_hz(rig.clock.now + 5.0) == 0.0


def series(rig: Rig, topic: str, field: str) -> list[tuple[float, float]]:
    """The whole curve: it is taken apart bit by bit."""
    points: list[tuple[float, float]] = []
    while len(more := rig.live.series(topic, field)) > len(points):
        points = more
    return points


def test_five_minutes_are_kept_at_full_rate() -> None:
    rig = Rig()
    rig.live.watch({"quick": "HelloWorld", "slow": "HelloWorld"})
    quick, slow = rig.writer("quick"), rig.writer("slow")
    for index in range(40_000):
        rig.clock.now = index * 0.01
        quick.write(hello(index))
        if index % 1000 == 0:
            slow.write(hello(index))
    points = series(rig, "quick", "index")
    assert [value for _, value in points] == [float(index) for index in range(10_000, 40_000)]
    assert [value for _, value in series(rig, "slow", "index")] == [1000.0 * number for number in range(10, 40)]
    assert rig.live.series("slow", "message") == rig.live.series("slow", "nothing") == rig.live.series("no", "x") == []


def test_a_curve_follows_and_what_is_kept_is_shared_by_many_topics() -> None:
    rig = Rig()
    topics = {f"t{number}": "HelloWorld" for number in range(100)}
    rig.live.watch(topics)
    writer = rig.writer("t0")
    for index in range(3 * MOST_KEPT_IN_ALL // 100):
        writer.write(hello(index))
    points = series(rig, "t0", "index")
    assert len(points) == MOST_KEPT_IN_ALL // 100
    writer.write(hello(4711))
    assert rig.live.series("t0", "index")[-1][1] == 4711


def test_the_small_curve_is_the_last_minute() -> None:
    rig = Rig()
    rig.live.watch({"a": "HelloWorld"})
    writer = rig.writer("a")
    for index in range(1000):
        rig.clock.now = index * 0.1
        writer.write(hello(index))
    watch = rig.live.topic("a")
    assert watch is not None
    assert watch.period_s == pytest.approx(0.1)
    values = rig.live.sparkline(watch, "index")
    assert SPARK_POINTS - 2 <= len(values) <= SPARK_POINTS
    assert values == sorted(values)
    assert values[0] >= 380


def test_nested_values_lists_octets_and_what_is_no_number_are_shown() -> None:
    rig = Rig()
    rig.live.watch({"a": "Everything"})
    everything = Everything(
        place=Place(x=1.5, name="<b>here</b>"),
        places=[Place(x=float(number), name="") for number in range(40)],
        numbers=[0.5],
        raw=b"\x01\xff",
        far=math.inf,
        on=True,
    )
    rig.writer("a", "Everything").write(everything.encode())
    fields = rig.fields("a")
    assert (fields["place.x"], fields["place.name"], fields["numbers"]) == (1.5, "<b>here</b>", "[0.5]")
    assert (fields["raw"], fields["far"], fields["on"]) == ("[1, 255]", "inf", True)
    assert str(fields["places"]).startswith('[[0.0, ""], [1.0, ""]')
    watch = rig.live.topic("a")
    assert watch is not None
    numbers = rig.live.numbers(watch)
    assert numbers["places[39].x"] == 39.0
    assert (numbers["numbers[0]"], numbers["raw[1]"], numbers["on"]) == (0.5, 255, True)
    assert "far" not in numbers


def test_lists_are_drawn_as_what_they_are() -> None:
    scan = draw("Scan", {"angle_min": -90.0, "angle_step": 45.0, "reach": 4.0, "metres": "[3.0, 0.5, 9.0]"})
    assert 'aria-label="nearest 0.50 m at -45°"' in scan
    assert "<polygon" in scan
    strip = draw("Strip", {"colours": "[[255, 0, 0], [0, 0, 0]]"})
    assert strip.count("<circle") == 2
    assert "fill:#ff0000" in strip
    assert 'aria-label="1 of 2 lamps shine"' in strip
    picture = draw("Picture", {"width": 2, "height": 1, "format": "mono8", "pixels": "[0, 255]"})
    assert "data:image/png;base64," in picture
    broken = draw("Picture", {"width": 2, "height": 2, "format": "mono8", "pixels": "[0, 255]"})
    assert "data:image" not in broken
    bars = draw("Own", {"some": f"[{', '.join(map(str, range(300)))}]"})
    assert bars.count("<rect") == 60
    assert 'aria-label="300 values"' in bars


def test_long_texts_are_cut() -> None:
    rig = Rig()
    rig.live.watch({"a": "HelloWorld"})
    rig.writer("a").write(hello(1, "x" * 250))
    assert rig.fields("a")["message"] == "x" * LONGEST_TEXT


def test_octets_of_an_unknown_type_are_shown_as_they_are() -> None:
    rig = Rig()
    rig.live.watch({"a": "Secret"})
    rig.writer("a", "Secret").write(b"\x01\x02")
    assert rig.fields("a") == {"octets": "01 02"}


@settings(deadline=None)
@given(st.binary(max_size=300))
def test_any_octets_on_a_topic_are_shown(octets: bytes) -> None:
    rig = Rig()
    rig.live.watch({"a": "Everything"})
    rig.writer("a", "Everything").write(octets)
    fields = rig.fields("a")
    assert bool(fields) == bool(octets)
    for value in fields.values():
        assert isinstance(value, bool | int | float | str)
        assert not isinstance(value, float) or math.isfinite(value)


@given(
    st.lists(st.one_of(st.binary(max_size=9), st.integers(1, 300), st.floats(0, 90)), max_size=400),
    st.integers(0, 400),
)
def test_the_newest_samples_are_kept_whatever_comes(acts: list[bytes | int | float], after: int) -> None:
    history, everything, most = _SampleHistory(200), list[tuple[float, bytes]](), 200
    least = 0
    """So many are kept at least."""
    for number, act in enumerate(acts):
        if isinstance(act, bytes):
            for copy in range(3):
                everything.append((float(number), act * copy))
                history.add(*everything[-1])
                least = min(least + 1, most)
        elif isinstance(act, int):
            history.keep_at_most(act)
            most, least = act, min(least, act)
        else:
            history.forget_until(number - act)
            least = min(least, sum(at >= number - act for at, _ in everything))
        assert history.total == len(everything)
        found = history.after(history.total - after)
        assert min(after, least) <= len(found) <= min(after, most)
        assert found == everything[len(everything) - len(found) :]
