"""Binding and rebinding ports: what the client is asked to create and delete."""

import pytest

from msbot.part.client.client import Client
from msbot.part.messages.standard import HelloWorld
from msbot.part.ports import Ports
from msbot_xrce.errors import ConfigError
from msbot_xrce.messages import STREAM_BEST_EFFORT, STREAM_RELIABLE, ObjectKind
from tests.part.wire import HandLink, publishes, subscribes


def make_ports() -> tuple[Client, Ports]:
    client = Client(HandLink(), key=1)
    participant = client.create_participant()
    return client, Ports(client, participant, client.create_subscriber(participant))


def kinds(client: Client) -> list[ObjectKind]:
    return [ObjectKind(entity.variant.kind) for entity in client.entities][2:]


def test_a_port_that_publishes_gets_topic_publisher_and_writer() -> None:
    client, ports = make_ports()
    ports.bind([publishes("out", "T"), publishes("more", "U")])
    assert kinds(client) == [
        ObjectKind.TOPIC,
        ObjectKind.PUBLISHER,
        ObjectKind.DATAWRITER,
        ObjectKind.TOPIC,
        ObjectKind.DATAWRITER,
    ]
    assert "out" in ports
    assert "in" not in ports


@pytest.mark.parametrize(("reliable", "stream_id"), [(True, STREAM_RELIABLE), (False, STREAM_BEST_EFFORT)])
def test_a_port_that_subscribes_is_read_on_its_stream(reliable: bool, stream_id: int) -> None:
    client, ports = make_ports()
    ports.bind([subscribes("in", "T", reliable=reliable)])
    assert kinds(client) == [ObjectKind.TOPIC, ObjectKind.DATAREADER]
    reader = client.entities[-1]
    assert reader.reading is not None
    assert reader.reading.stream_id == stream_id
    bound = ports.port_of(reader.object_id)
    assert bound is not None
    assert bound.binding.port == "in"
    assert ports.port_of(0x0FF6) is None


def test_ports_that_stay_the_same_keep_their_objects() -> None:
    client, ports = make_ports()
    ports.bind([publishes("out", "T"), subscribes("in", "U")])
    before = client.entities
    ports.bind([subscribes("in", "U"), publishes("out", "T")])
    assert client.entities == before
    ports.bind([publishes("out", "new"), subscribes("in", "U")])
    assert [entity for entity in before if entity not in client.entities] == [before[2], before[4]]
    binding = ports.binding("out")
    assert binding is not None
    assert binding.topic == "new"


def test_ports_that_are_gone_take_their_objects_along() -> None:
    client, ports = make_ports()
    ports.bind([publishes("out", "T"), subscribes("in", "U")])
    ports.bind([])
    assert kinds(client) == [ObjectKind.PUBLISHER]
    assert ports.binding("in") is None
    assert ports.describe == "this robot binds no port of the part"
    ports.bind([publishes("out", "T")])
    ports.unbind_all()
    assert kinds(client) == []
    ports.unbind_all()


def test_a_direction_that_nobody_knows_is_taken_for_subscribe() -> None:
    _, ports = make_ports()
    strange = subscribes("in", "U")
    strange.direction = 7
    ports.bind([strange])
    with pytest.raises(ConfigError, match=r"bound in this robot: in \(subscribe HelloWorld\)"):
        ports.publish("in", HelloWorld(index=0, message=""))
