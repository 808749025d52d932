"""A part of the soak, in a process of its own: it publishes numbered samples and tells what happens to it.

Each line on stdout is a JSON list: the kind of event, the time (CLOCK_MONOTONIC, which all processes of a computer
share), and what belongs to it. `oracle.py` reads them.
"""

from __future__ import annotations

import argparse
import json
import os
import threading
import time
import zlib
from itertools import count
from random import Random

from msbot import HelloWorld, LocalProtocolError, Part

LARGE_EVERY = 40
"""Every so many samples, one is larger than a packet."""
LARGE = 3000
STALL_S = 0.5
"""A process that gets no turn for so long says so."""
NAP_S = 0.1


def say(*event: object) -> None:
    """One line, in one write: a process that is killed leaves whole lines."""
    os.write(1, json.dumps(event, separators=(",", ":")).encode() + b"\n")


def tell_stalls() -> None:
    """Say how long this process stood still, whatever the reason: frozen, or no processor for it."""
    while True:
        began = time.monotonic()
        time.sleep(NAP_S)
        late = time.monotonic() - began - NAP_S
        if late > STALL_S:
            say("stall", began, late)


def make(slot: str, uid: bytes, key: str | None, period_s: float, large: int) -> Part:
    """The part, with the functions that tell."""
    part = Part(f"SOAK-{slot}", local_name=slot, uid=uid, key=key)
    boot = os.urandom(4).hex()
    epochs = count(1)
    state = {"epoch": 0, "number": 0, "large": large}
    dice = Random(boot)

    @part.every(period_s)
    def publish() -> None:
        number, at = state["number"], time.monotonic()
        is_large = state["large"] and number % LARGE_EVERY == LARGE_EVERY - 1
        filling = "x" * dice.randrange(large // 2, large) if is_large else ""
        words = f"{slot} {boot} {state['epoch']} {number} {zlib.crc32(filling.encode()):08x} {filling}"
        try:
            is_sent = part.publish("out", HelloWorld(index=number, message=words))
        except LocalProtocolError as error:  # best effort has no fragments: it is said in words, and not tried again
            state["large"] = 0
            say("refused", at, state["epoch"], str(error))
            return
        if is_sent:
            state["number"] += 1
            say("sent", at, state["epoch"], number)

    @part.on("in", HelloWorld)
    def hear(message: HelloWorld) -> None:
        at = time.monotonic()
        whose, its_boot, epoch, number, check, filling = (message.message + "      ").split(" ", 5)
        whole = check == f"{zlib.crc32(filling.rstrip().encode()):08x}" and number == str(message.index)
        if not whole:
            say("damaged", at, message.message[:80])
            return
        say("got", at, state["epoch"], whose, its_boot, int(epoch), int(number))

    @part.on_setting("note", str)
    def note(value: str) -> None:
        say("note", time.monotonic(), value)

    @part.on_join
    def joined() -> None:
        state.update(epoch=next(epochs), number=0, large=large)
        say("join", time.monotonic(), state["epoch"], part.slot, part.stopped)

    @part.on_lost
    def lost() -> None:
        say("lost", time.monotonic(), state["epoch"], part.reason)

    @part.on_stop
    def stop() -> None:
        say("stop", time.monotonic())

    @part.on_go
    def go() -> None:
        say("go", time.monotonic())

    say("boot", time.monotonic(), boot)
    return part


def main() -> None:
    """Be a part until a signal comes."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("slot")
    parser.add_argument("--uid", required=True)
    parser.add_argument("--key")
    parser.add_argument("--link", required=True)
    parser.add_argument("--period", type=float, default=0.25)
    parser.add_argument("--large", type=int, default=LARGE)
    options = parser.parse_args()
    threading.Thread(target=tell_stalls, daemon=True).start()
    part = make(options.slot, bytes.fromhex(options.uid), options.key, options.period, options.large)
    part.run(["--quiet", "--link", options.link])


if __name__ == "__main__":
    main()
