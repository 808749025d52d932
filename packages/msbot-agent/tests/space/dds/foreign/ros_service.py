"""A service of ROS 2 as rmw_cyclonedds has it on the wire, with the package `cyclonedds`: its header is in the type.

ros_service.py serve      adds for everybody who asks
ros_service.py ask A B    asks once somebody serves, and prints "sum N"
"""

import os
import sys
import time
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct, types
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

ASKER = 0x1122334400000000 | os.getpid()


@dataclass
class Request(IdlStruct, typename="example_interfaces::srv::dds_::AddTwoInts_Request_"):  # type: ignore[misc,call-arg]
    guid: types.uint64
    seq: types.int64
    a: types.int64
    b: types.int64


@dataclass
class Reply(IdlStruct, typename="example_interfaces::srv::dds_::AddTwoInts_Response_"):  # type: ignore[misc,call-arg]
    guid: types.uint64
    seq: types.int64
    sum: types.int64


def main(do: str, *numbers: str) -> None:
    participant = DomainParticipant(0)
    requests = Topic(participant, "rq/add_two_intsRequest", Request)
    replies = Topic(participant, "rr/add_two_intsReply", Reply)
    qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(10))
    if do == "serve":
        reader, writer = DataReader(participant, requests, qos=qos), DataWriter(participant, replies, qos=qos)
        say("ready")
        while True:
            for request in reader.take(10):
                if isinstance(request, Request):
                    writer.write(Reply(request.guid, request.seq, request.a + request.b))
            time.sleep(0.001)
    reader, writer = DataReader(participant, replies, qos=qos), DataWriter(participant, requests, qos=qos)
    say("ready")
    while not (writer.get_matched_subscriptions() and reader.get_matched_publications()):
        time.sleep(0.005)
    writer.write(Request(ASKER, 7, int(numbers[0]), int(numbers[1])))
    while True:
        for reply in reader.take(10):
            if isinstance(reply, Reply) and reply.guid == ASKER:
                say(f"sum {reply.sum} of request {reply.seq}")
                sys.stdin.read()
                return
        time.sleep(0.001)


def say(words: str) -> None:
    print(words, flush=True)


main(*sys.argv[1:])
