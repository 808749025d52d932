"""The drawing of the wires: who publishes what to whom, and no name that becomes markup."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from msbot_web.language import languages
from msbot_web.models.robot_models import TopicLine, WirePort
from msbot_web.svg.wiring_graph import STATE_COLOURS, _port_words, wiring_svg
from tests.web.pictures import HARMFUL, names, read, words

ENGLISH = languages()["en"]
ends = st.builds(lambda slot, port: f"{slot}.{port}", names, names)


def topic(name: str, publishers: list[str], subscribers: list[str], rate_hz: float = 0.0) -> TopicLine:
    return TopicLine(
        topic=name,
        type_name="Level",
        publishers=publishers,
        subscribers=subscribers,
        rate_hz=rate_hz,
        count=7,
        fields={},
    )


def ports_of(*lines: TopicLine) -> list[WirePort]:
    """The ports that the topics join."""
    found = {}
    for line in lines:
        for is_source, many in ((True, line.publishers), (False, line.subscribers)):
            for end in many:
                slot, _, name = end.rpartition(".")
                found[end, is_source] = WirePort(
                    slot=slot, port=name, type_name=line.type_name, publishes=is_source, topic=line.topic
                )
    return list(found.values())


def test_every_end_is_joined_to_its_topic_and_slots_lead_to_their_drawer() -> None:
    lines = [topic("speed", ["knob.turn"], ["fan.power", "lamp.power"], 10.0)]
    root = read(wiring_svg(lines, ports_of(*lines), {"knob": "active", "fan": "lost"}, ENGLISH))
    links = [link.get("href") for link in root.findall(".//{*}a")]
    assert links == ["/?slot=knob", "/?slot=fan", "/?slot=lamp"]
    colours = [box.get("stroke") for box in root.findall(".//{*}a/{*}rect")]
    assert colours == [STATE_COLOURS[state] for state in ("active", "lost", "empty")]
    text = words(root)
    assert "10.0 Hz · 7 samples" in text
    assert [port.get("data-port") for port in root.findall(".//{*}g[@data-port]")] == [
        "knob.turn",
        "fan.power",
        "lamp.power",
    ]
    assert root[0].get("aria-label") == "knob.turn to fan.power, lamp.power by speed"


def test_flowing_wires_differ_from_silent_ones_in_more_than_colour() -> None:
    both = [[topic("t", ["a.x"], ["b.y"], rate)] for rate in (2.0, 0.0)]
    busy, silent = (wiring_svg(lines, ports_of(*lines), {}, ENGLISH) for lines in both)
    assert "stroke-dasharray" not in busy
    assert "stroke-dasharray" in silent


def test_a_slot_that_hears_itself_stands_on_both_sides() -> None:
    line = topic("t", ["a.x"], ["a.y"])
    assert len(read(wiring_svg([line], ports_of(line), {}, ENGLISH)).findall(".//{*}a")) == 2


def test_a_port_without_a_wire_is_there_and_says_so() -> None:
    port = WirePort(slot="fan", port="power", type_name="Level", publishes=False)
    root = read(wiring_svg([], [port], {}, ENGLISH))
    (drawn,) = root.findall(".//{*}g[@data-port]")
    assert (drawn.get("role"), drawn.get("tabindex"), drawn.get("data-way")) == ("button", "0", "in")
    assert drawn.get("aria-label") == "fan.power (Level): not wired"


def test_only_who_may_change_the_robot_is_offered_to_take_slots_out() -> None:
    lines = [topic("speed", ["knob.turn"], ["fan.power"])]
    for may_change, slots in ((True, ["knob", "fan"]), (False, [])):
        root = read(wiring_svg(lines, ports_of(*lines), {}, ENGLISH, may_change=may_change))
        crosses = root.findall(".//{*}g[@data-slot]")
        assert [cross.get("data-slot") for cross in crosses] == slots
        assert [cross.get("aria-label") for cross in crosses] == [f"Take slot {slot} out" for slot in slots]


@settings(deadline=None)
@given(
    st.lists(
        st.builds(topic, names, st.lists(ends, max_size=3), st.lists(ends, max_size=3), st.floats(0, 1e4)),
        max_size=4,
        unique_by=lambda line: line.topic,
    )
)
def test_any_names_are_drawn_as_text(lines: list[TopicLine]) -> None:
    text = words(read(wiring_svg(lines, ports_of(*lines), {HARMFUL: HARMFUL}, ENGLISH)))
    for line in lines:
        assert line.topic in text


def test_ports_of_services_say_what_they_do() -> None:
    ports = [
        WirePort(slot="eye", port="photo", type_name="Angle -> Text", publishes=True, topic="photo"),
        WirePort(slot="brain", port="look", type_name="Angle -> Text", publishes=False, topic="photo"),
    ]
    assert [_port_words(port, ENGLISH) for port in ports] == [
        "eye.photo (Angle -> Text): serves photo",
        "brain.look (Angle -> Text): calls photo",
    ]


def test_a_topic_is_drawn_beside_its_ports() -> None:
    """In a robot of many slots a wire is on the screen with its slots, and no topic covers another."""
    lines = [topic(f"t{number}", [f"{number:02d}.out"], [f"{number:02d}.in"]) for number in (0, 1, 40)]
    wired = {(port.slot, port.publishes): port for port in ports_of(*lines)}
    ports = [
        wired.get((f"{number:02d}", way))
        or WirePort(slot=f"{number:02d}", port="out" if way else "in", type_name="Level", publishes=way)
        for number in range(60)
        for way in (True, False)
    ]
    (drawing,) = read(wiring_svg(lines, ports, {}, ENGLISH))
    at = {text.get("data-rate"): float(text.get("y", "")) for text in drawing.findall(".//{*}text[@data-rate]")}
    height = float(drawing.get("viewBox", "").split()[3])
    assert at["t0"] < at["t1"] < height / 10
    assert at["t1"] - at["t0"] >= 64
    assert height / 2 < at["t40"] < height * 0.75
