"""What the units of systemd start: `start` before the network, `grow` once the card is mounted, `serve` for the page,
`bus` before the master, `bus-came` when a CAN hat is there, `trial` after a start with an update."""

from __future__ import annotations

import contextlib
import os
import socket
import sys
import time
import urllib.request

from msbot_card.requests import serve
from msbot_card.system import System, say

TRIAL_S, LOOK_S = 300.0, 3.0
"""How long an update's page may take to be healthy, and how often it is asked."""
LONGER = "MSBOT_CARD_TRIAL_S"
"""Names another time than `TRIAL_S`: an emulated computer is slow. `systemd.setenv=` in cmdline.txt hands it on."""
MOST_ENDS = 3
"""How often the master of an update may end by itself: then nobody has to wait for the end of the time."""
HEALTH = "http://127.0.0.1/api/health"


def main(words: list[str]) -> int:
    """Do what the unit is for."""
    system = System()
    match words:
        case ["start"]:
            system.start()
        case ["grow"]:
            system.grow()
        case ["serve"]:
            serve(socket.socket(fileno=3), system)
        case ["bus"]:
            system.use_bus()
        case ["bus-came"]:
            system.bus_came()
        case ["trial"]:
            trial(system)
        case _:
            say("msbot-card: start, grow, serve, bus, bus-came or trial")
            return 2
    return 0


def trial(system: System) -> None:
    """Ask an update's page how it is; without a good answer, start again with the former version."""
    if not system.store.versions().trial:
        return
    until, healthy = time.monotonic() + trial_s(os.environ.get(LONGER, "")), False
    while system.has_update_in_force and not healthy and time.monotonic() < until:
        if system.ends_of_master() > MOST_ENDS:
            break
        time.sleep(LOOK_S)
        with contextlib.suppress(OSError), urllib.request.urlopen(HEALTH, timeout=LOOK_S) as page:
            healthy = page.status == 200
    system.store.end_trial(healthy=healthy)
    say("the update is well" if healthy else "the update's page is not healthy: back to the former version")
    if not healthy:
        system.restart()


def trial_s(asked: str) -> float:
    """How long a trial takes: what was asked for, if that makes sense."""
    return float(asked) if asked.isdecimal() and 0 < int(asked) < 86_400 else TRIAL_S


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
