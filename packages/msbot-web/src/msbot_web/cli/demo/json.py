"""The JSON object of `msbot demo --json`; its keys are described in docs/tutorial/demo.md."""

from __future__ import annotations

from msbot_school.demo import DemoRobot

Json = dict[str, "Json"] | list["Json"] | str | float | int | bool | None


def as_json(robot: DemoRobot) -> Json:
    """Everything that happened, as values that `json.dumps` takes."""
    snapshot = robot.snapshot()
    bus = snapshot.bus
    return {
        "robot": snapshot.robot,
        "link": snapshot.link,
        "parts": [
            {
                "name": part.name,
                "part_number": part.part_number,
                "slot": part.slot,
                "state": part.state,
                "plug_in_to_active_ms": _rounded(part.plug_in_to_active_ms),
                "beats": part.beats,
                "life": part.life,
            }
            for part in snapshot.parts
        ],
        "topics": [
            {"name": topic.name, "published": topic.published, "delivered": topic.delivered}
            for topic in snapshot.topics
        ],
        "bus": None
        if bus is None
        else {
            "bitrate": bus.bitrate,
            "frames": bus.frames,
            "bits": bus.bits,
            "load_percent": _rounded(bus.load_percent),
            "errors": bus.errors,
        },
        "events": [
            {
                "at_s": _rounded(event.at_s),
                "part": event.part,
                "from": event.from_state,
                "to": event.to_state,
                "reason": event.reason,
                "slot": event.slot,
            }
            for event in robot.events
        ],
    }


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)
