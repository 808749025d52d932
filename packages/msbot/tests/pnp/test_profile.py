"""The profile: the thesis' values and the hash of a CAN beacon."""

from __future__ import annotations

import zlib

from msbot.part.join import pnp_messages
from msbot.pnp import PROFILE_PERIOD_S, PROFILE_TOPIC, PROFILE_TYPE, Profile


def test_the_default_profile_is_that_of_the_thesis() -> None:
    assert Profile() == Profile("MSBOT_MASTER", "MSBOT_V1", "X100Y100Z100", "8-4-2021", "MASSEY_ENGINEERING_DEP")


def test_the_hash_is_the_crc_of_name_version_and_serial_number() -> None:
    assert Profile().profile_hash() == zlib.crc32(b"MSBOT_MASTER\0MSBOT_V1\0X100Y100Z100")


def test_robots_with_shifted_fields_have_different_hashes() -> None:
    assert Profile("ab", "c", "d").profile_hash() != Profile("a", "bc", "d").profile_hash()


def test_date_and_manufacturer_are_not_part_of_the_identity() -> None:
    assert Profile(released="today", manufacturer="me").profile_hash() == Profile().profile_hash()


def test_topic_type_and_period_are_those_that_parts_know() -> None:
    assert (PROFILE_TOPIC, PROFILE_TYPE) == (pnp_messages.PROFILE_TOPIC, pnp_messages.PROFILE_TYPE)
    assert PROFILE_PERIOD_S == pnp_messages.PROFILE_PERIOD_S
