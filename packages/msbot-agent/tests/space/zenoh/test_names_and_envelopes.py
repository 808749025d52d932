"""The pure parts: keys, tokens, envelopes, addresses."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_agent.space import Qos, SpaceAddress, parse_space
from msbot_agent.space.zenoh.key_expressions import data_key, endpoint_of, has_wildcards, partition_of, token_key
from msbot_agent.space.zenoh.sample_envelope import EnvelopeWriter, read_envelope
from msbot_agent.space.zenoh.zenoh_library import load
from msbot_xrce.errors import ConfigError

NAMES = st.text(min_size=1, max_size=20)
QOS = st.builds(
    Qos,
    reliable=st.booleans(),
    transient_local=st.booleans(),
    exclusive=st.booleans(),
    deadline_s=st.none() | st.sampled_from((0.1, 2.0, 3600.0)),
    strength=st.integers(-(2**31), 2**31 - 1),
    lifespan_s=st.none() | st.sampled_from((0.5, 60.0)),
)


@given(NAMES, st.integers(0, 232), NAMES, NAMES)
def test_every_name_makes_a_key_that_the_library_accepts(partition: str, domain: int, topic: str, name: str) -> None:
    keys = pytest.importorskip("zenoh").KeyExpr
    key = data_key(partition, domain, topic, name)
    assert str(keys(key)) == key
    if not has_wildcards(partition):
        assert partition_of(key) == partition
        token = token_key(key, bytes(16), Qos(), writes=True)
        assert str(keys(token)) == token
        assert not keys(key.rpartition("/")[0] + "/**").includes(keys(token))  # no sample is taken for a token


@given(NAMES, NAMES, QOS, st.booleans(), st.binary(min_size=16, max_size=16))
def test_an_endpoint_is_read_as_it_was_announced(topic: str, name: str, qos: Qos, writes: bool, guid: bytes) -> None:
    found = endpoint_of(token_key(data_key("", 0, topic, name), guid, qos, writes=writes))
    assert found is not None
    assert (found.guid, found.type_name, found.is_writer) == (guid, name, writes)
    for policy in ("reliable", "transient_local", "exclusive", "deadline_s"):
        assert getattr(found.qos, policy) == getattr(qos, policy)


@given(st.text(max_size=60))
def test_tokens_of_others_never_raise(text: str) -> None:
    endpoint_of(text)
    endpoint_of(f"msbot/-/0/a/A/@graph/{text}")


@given(QOS, st.integers(1, 2**64 - 1), st.none() | st.tuples(st.binary(min_size=16, max_size=16), st.integers(0, 99)))
def test_an_envelope_is_read_as_it_was_sealed(qos: Qos, number: int, related: tuple[bytes, int] | None) -> None:
    found = read_envelope(EnvelopeWriter(bytes(16), qos).seal(number, related, is_repeated=number % 2 == 0))
    assert found is not None
    assert (found.number, found.related, found.is_repeated) == (number, related, number % 2 == 0)
    assert found.offered.strength == qos.strength
    assert found.offered.deadline_s == pytest.approx(qos.deadline_s) if qos.deadline_s else not found.offered.deadline_s


@given(st.binary(max_size=70))
def test_envelopes_of_others_never_raise(octets: bytes) -> None:
    read_envelope(octets)


def test_addresses() -> None:
    assert parse_space("zenoh").routers == ("tcp/127.0.0.1:7447",)
    assert parse_space("zenoh:tcp/a.b:1,tcp/[::1]:65535").routers == ("tcp/a.b:1", "tcp/[::1]:65535")
    secure = parse_space("zenoh:tls/a:1?ca=ca.pem&cert=n.pem&key=n.key")
    assert isinstance(secure, SpaceAddress)
    assert secure.tls is not None
    assert [str(path) for path in (secure.tls.ca, secure.tls.certificate, secure.tls.key)] == [
        "ca.pem",
        "n.pem",
        "n.key",
    ]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("zenoh:", "'' is no endpoint: tcp/HOST:PORT or tls/HOST:PORT is needed"),
        ("zenoh:tpc/a:1", "'tpc/a:1' is no endpoint"),
        ("zenoh:tcp/a", "'tcp/a' is no endpoint"),
        ("zenoh:tcp/a:0", "a port is a number from 1 to 65535"),
        ("zenoh:tcp/a:70000", "a port is a number from 1 to 65535"),
        ("zenoh:tls/a:1", "tls needs the certificate of those to be accepted"),
        ("zenoh:tls/a:1?ca=c&cert=d", "cert and key belong together"),
        ("zenoh:tcp/a:1?ca=c", "certificates are for endpoints that begin with tls/"),
        ("zenoh:tcp/a:1?interface=eth0", "zenoh has the options ca, cert and key, not 'interface'"),
        ("xenoh", "is not a data space"),
    ],
)
def test_mistakes_in_addresses_are_one_sentence(text: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_space(text)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_library_is_new_enough() -> None:
    pytest.importorskip("zenoh")
    load()
