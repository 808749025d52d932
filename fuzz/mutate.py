"""Changing octets and cases at random."""

from __future__ import annotations

from collections.abc import Sequence
from random import Random

from fuzz.case import Case, Step

INTERESTING = (0, 1, 2, 3, 4, 5, 7, 8, 15, 16, 17, 23, 24, 31, 32, 63, 64, 127, 128, 129, 254, 255)
"""Octets at which lengths, kinds, flags and session ids change their meaning."""
WIDE = (0, 1, 3, 4, 0xFF, 0x100, 0x7FFF, 0x8000, 0xFFFC, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
"""Numbers of two or four octets at which something overflows."""
LONGEST = 70_000
"""Octets that a changed input may have, unless it was longer before."""
MOST_STEPS = 200


def mutate_octets(random: Random, data: bytes, others: Sequence[bytes] = ()) -> bytes:
    """Octets that differ from `data` in a few places; `others` are spliced in."""
    octets = bytearray(data)
    for _ in range(random.choice((1, 1, 1, 2, 2, 3, 5, 9))):
        _change(random, octets, others)
    return bytes(octets[: max(LONGEST, len(data))])


def _change(random: Random, octets: bytearray, others: Sequence[bytes]) -> None:
    size = len(octets)
    at = random.randrange(size) if size else 0
    match random.randrange(12):
        case 0 if size:
            octets[at] ^= 1 << random.randrange(8)
        case 1 | 2 if size:
            octets[at] = random.choice(INTERESTING)
        case 3 if size:
            octets[at] = random.randrange(256)
        case 4:
            del octets[at:]
        case 5:
            del octets[at : at + random.choice((1, 2, 3, 4, 8, 64))]
        case 6:
            octets[at:at] = random.randbytes(random.choice((1, 2, 3, 4, 5, 16, 100)))
        case 7:
            octets[at:at] = octets[at : at + random.choice((1, 4, 12, 64, 512))] * random.choice((1, 2, 2, 30))
        case 8 if size > 1:
            width = random.choice((2, 4))
            octets[at : at + width] = random.choice(WIDE).to_bytes(4, "little")[:width]
        case 9 if size > 1:
            number = int.from_bytes(octets[at : at + 2], "little") + random.choice((-4, -1, 1, 4, 0x100))
            octets[at : at + 2] = (number & 0xFFFF).to_bytes(2, "little")
        case 10 if others:
            other = random.choice(others)
            cut = random.randrange(len(other) + 1)
            octets[at:] = other[cut:]
        case _:
            octets += bytes(random.choice((1, 3, 4, 60)))


def mutate_case(random: Random, pool: Sequence[Case]) -> Case:
    """A case made of one or two of the pool's, changed in a few places."""
    steps = list(random.choice(pool))
    if random.random() < 0.3:
        other = random.choice(pool)
        steps[random.randrange(len(steps) + 1) :] = other[random.randrange(len(other) + 1) :]
    for _ in range(random.choice((1, 1, 2, 3, 6))):
        _change_steps(random, steps, pool)
    return tuple(steps[:MOST_STEPS])


def _change_steps(random: Random, steps: list[Step], pool: Sequence[Case]) -> None:
    if not steps:
        steps.extend(random.choice(pool))
        return
    at = random.randrange(len(steps))
    step = steps[at]
    match random.randrange(8):
        case 0:
            del steps[at : at + random.choice((1, 1, 2, 5))]
        case 1:
            steps[at:at] = [step] * random.choice((1, 1, 2, 20))
        case 2:
            other = random.randrange(len(steps))
            steps[at], steps[other] = steps[other], steps[at]
        case 3 if step.numbers:
            numbers = list(step.numbers)
            which = random.randrange(len(numbers))
            numbers[which] = random.choice((0, 1, 2, -1, numbers[which] * 2, numbers[which] + 1, random.random()))
            steps[at] = Step(step.verb, step.data, tuple(numbers))
        case 4:
            donor = random.choice(pool)
            if donor:
                steps.insert(at, random.choice(donor))
        case _ if step.data:
            others = [other.data for other in steps if other.data]
            steps[at] = Step(step.verb, mutate_octets(random, step.data, others), step.numbers)
        case _:
            steps.insert(at, random.choice(steps))
