"""A driver, a kind of fault, and a check of the doctor."""

import os
from random import Random

from msbot.doctor import Check, Examined, Finding
from msbot.hardware import Driver, Values
from msbot_agent.link import Peer
from msbot_school.faults import Amount, FaultKind, InjectionPoint, PacketFault


class LoadMeter(Driver):
    """Reads how many programs of this computer want to run."""

    samples = True

    def sample(self, values: Values) -> Values:
        return {"busy": os.getloadavg()[0]}


class Hiccup:
    """One packet in ten waits."""

    def __init__(self, seconds: float, random: Random) -> None:
        self.seconds, self.random = seconds, random

    def delays(self, peer: Peer, now: float, *, inward: bool) -> list[float]:
        return [self.seconds if self.random.random() < 0.1 else 0.0]

    def free_at(self, peer: Peer, now: float) -> float:
        return now


def load(patient: Examined) -> float:
    return os.getloadavg()[0]


def judge(load: float) -> list[Finding]:
    saw = f"{load:.1f} programs want to run"
    return [Finding("busy", "this computer", saw, "beats may be late", "late beats", "top")] if load > 20 else []


AMOUNT = Amount(1.0, 0.1, 10.0, "s", "that it waits")
HICCUP = PacketFault(FaultKind("hiccup", "a packet in ten waits", InjectionPoint.EDGE, amount=AMOUNT), Hiccup)
LOAD = Check("load", load, judge)
