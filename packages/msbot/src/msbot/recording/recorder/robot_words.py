"""How a recording tells what a robot is: its blueprint, the changes of its parts, and what people do to it by hand."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from msbot.config import Blueprint, Scalar
from msbot.pnp import PartEvent
from msbot_agent.text.sentence import to_json


def blueprint_words(blueprint: Blueprint, links: Sequence[str]) -> dict[str, object]:
    """Slots and wires, as `/msbot/blueprint` has them."""
    timing = blueprint.timing
    return {
        "beat_s": timing.beat_period_s, "tick_s": timing.tick_period_s, "life": timing.life, "links": [*links],
        "slots": [
            {"slot": one.name, "part_number": one.part_number, "description": one.description}
            for one in blueprint.slots
        ],
        "wires": [
            {"topic": one.topic, "type": one.type_name, "reliable": one.reliable,
             "from": [one.source.slot, one.source.port], "to": [[end.slot, end.port] for end in one.targets]}
            for one in blueprint.bindings
        ],
    }  # fmt: skip


def event_words(event: PartEvent) -> dict[str, object]:
    """A change of a part's state, as `/msbot/events` has it."""
    return {
        "part": event.part, "slot": event.slot, "part_number": event.part_number,
        "from": None if event.from_state is None else event.from_state.value, "to": event.to_state.value,
        "reason": event.reason, "evidence": [list(pair) for pair in event.evidence], "uid": event.uid.hex(),
        "client_key": event.client_key, "words": event.sentences()[0], "identity": event.identity.hex(),
        "said": to_json(event.reason),
    }  # fmt: skip


def shown_words(
    by_hand: Mapping[tuple[str, str], Mapping[str, Scalar]],
    faults: Callable[[str], Sequence[str]],
    blueprint: Blueprint,
) -> dict[str, object]:
    """What pages show besides, as `/msbot/shown` has it: values driven by hand, and faults as far as they are told."""
    told = {name: [to_json(words) for words in faults(name)] for name in ("", *(one.name for one in blueprint.slots))}
    return {
        "by_hand": [[slot, port, dict(fields)] for (slot, port), fields in by_hand.items()],
        "faults": {name: words for name, words in told.items() if words},
    }
