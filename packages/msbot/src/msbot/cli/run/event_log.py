"""What happens to parts, as lines of a log in JSON."""

from __future__ import annotations

import logging

from msbot.pnp.part_events import PartEvent
from msbot_agent.cli.logs import EVENTS
from msbot_agent.log.log_forms import ALWAYS, FIELDS

_events = logging.getLogger(EVENTS)


def log_event(event: PartEvent) -> None:
    """A change of a part as a line of the log, with its values."""
    fields = {
        "part": event.part,
        "slot": event.slot or "",
        "from": event.from_state.value if event.from_state else "",
        "to": event.to_state.value,
        "reason": str(event.reason),
        "uid": event.uid.hex(),
    }
    # What happens to parts in slots is bounded by their number; strangers may come without end.
    _events.info("%s", event.sentences()[0], extra={FIELDS: fields, ALWAYS: bool(event.slot)})
