"""Addresses of people who are signed in are known for a while; how many is bounded."""

from __future__ import annotations

from msbot_web.known_addresses import KEPT_S, MOST, KnownAddresses


def test_an_address_is_known_for_a_while_after_somebody_signed_in_came_from_it() -> None:
    now = [100.0]
    known = KnownAddresses(lambda: now[0])
    assert not known.knows("10.0.0.1")
    known.note("10.0.0.1")
    now[0] += KEPT_S - 1
    assert known.knows("10.0.0.1")
    now[0] += 2
    assert not known.knows("10.0.0.1")


def test_who_came_last_is_known_however_many_come() -> None:
    known = KnownAddresses(lambda: 0.0)
    for number in range(MOST):
        known.note(f"address {number}")
    known.note("address 0")
    known.note("one more")
    assert known.knows("address 0")
    assert not known.knows("address 1")
