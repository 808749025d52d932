"""A program with the package `cyclonedds` and a typed topic; its arguments and lines are those of cyclone_peer.c."""

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


@dataclass
class Msg(IdlStruct, typename="HelloWorldData::Msg"):  # type: ignore[misc,call-arg]
    userID: types.int32
    message: str


def main(do: str, name: str, count: int, reliability: str, durability: str) -> None:
    durable = durability == "transient_local"
    policies = [
        Policy.Reliability.Reliable(duration(seconds=10))
        if reliability == "reliable"
        else Policy.Reliability.BestEffort,
        Policy.Durability.TransientLocal if durable else Policy.Durability.Volatile,
        Policy.History.KeepLast(100),
    ]
    if durable:
        policies.append(Policy.DurabilityService(0, Policy.History.KeepLast(100), -1, -1, -1))
    participant = DomainParticipant(0)
    topic = Topic(participant, name, Msg)
    if do == "write":
        writer = DataWriter(participant, topic, qos=Qos(*policies))
        say("ready")
        while not durable and not writer.get_matched_subscriptions():
            time.sleep(0.005)
        if durability == "when_told":
            sys.stdin.readline()
        for number in range(count):
            writer.write(Msg(number, f"hello {number}"))
        say("wrote")
    else:
        reader = DataReader(participant, topic, qos=Qos(*policies))
        say("ready")
        seen = 0
        while seen < count:
            for message in reader.take(1):
                if isinstance(message, Msg):
                    say(f"got {message.userID} {message.message}")
                    seen += 1
            time.sleep(0.001)
    sys.stdin.read()


def say(words: str) -> None:
    print(words, flush=True)


main(sys.argv[1], sys.argv[2], int(sys.argv[3]), sys.argv[4], sys.argv[5])
