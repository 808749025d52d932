"""A DDS-XRCE client over a bare UDP socket: the core does the protocol, this file the time and the bytes."""

import socket
import sys
import time

from msbot_xrce import ClientSession
from msbot_xrce.messages import STREAM_RELIABLE, CdrReader, CdrWriter, DeliveryControl
from msbot_xrce.objects import (
    participant_variant,
    publisher_variant,
    reader_variant,
    subscriber_variant,
    topic_variant,
    writer_variant,
)
from msbot_xrce.sessions import Connected, DataReceived, StatusReceived

PARTICIPANT, TOPIC, PUBLISHER, SUBSCRIBER, WRITER, READER = 0x11, 0x12, 0x13, 0x14, 0x15, 0x16
agent = (sys.argv[1], int(sys.argv[2]))
session = ClientSession(0x0BADCAFE, epoch_ns=time.time_ns)
wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
wire.connect(agent)
session.connect(time.monotonic())
heard, created = "", 0
while not heard:
    now = time.monotonic()
    session.handle_timer(now)
    while (event := session.next_event()) is not None:
        if isinstance(event, Connected):
            session.create(PARTICIPANT, participant_variant("core"))
            session.create(TOPIC, topic_variant("greeting", "Text", PARTICIPANT))
            session.create(PUBLISHER, publisher_variant(PARTICIPANT))
            session.create(SUBSCRIBER, subscriber_variant(PARTICIPANT))
            session.create(WRITER, writer_variant(TOPIC, PUBLISHER))
            session.create(READER, reader_variant(TOPIC, SUBSCRIBER))
            session.read(READER, STREAM_RELIABLE, DeliveryControl())
        elif isinstance(event, StatusReceived) and (created := created + 1) == 6:
            text = CdrWriter()
            text.string("hello from the core")
            session.write(WRITER, text.finish(), STREAM_RELIABLE)
        elif isinstance(event, DataReceived):
            heard = CdrReader(event.payload).string()
    for packet in session.packets_to_send(now):
        wire.send(packet)
    due = session.timer()
    wire.settimeout(max(0.001, min(1.0, 1.0 if due is None else due - time.monotonic())))
    try:
        session.receive_packet(wire.recv(65535), time.monotonic())
    except TimeoutError:
        pass
    except ConnectionRefusedError:
        time.sleep(0.1)  # nobody listens there yet
print(heard)
