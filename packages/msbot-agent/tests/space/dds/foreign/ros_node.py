"""A ROS 2 node as it is on the wire, with the package `cyclonedds`: does what its arguments say, one after the other.

nodes NAME TOPIC      waits until a node of that name is told with that topic, and prints what DDS knows of it
gone NAME             waits until it is told no more
call NODE SERVICE X   calls a parameter service; X is the request in JSON; prints the reply
hear TOPIC TYPE N     prints N messages of a topic, each as JSON
wait WORD             waits for that line on its input
"""

# mypy: ignore-errors
import dataclasses
import json
import os
import sys
import time

import ros_types
from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

SERVICES = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(10))
LATCHED = Qos(
    Policy.Reliability.Reliable(duration(seconds=1)), Policy.Durability.TransientLocal, Policy.History.KeepLast(1)
)
BEST_EFFORT = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(1))
ME = 0x5566778800000000 | os.getpid()


class Node:
    def __init__(self):
        self.participant = DomainParticipant(0, Qos(Policy.Userdata(b"enclave=/;")))
        # As rmw_dds_common: all that is told is kept, by participant the last.
        keep_all = Qos(
            Policy.Reliability.Reliable(duration(seconds=1)), Policy.Durability.TransientLocal, Policy.History.KeepAll
        )
        self.topic = Topic(self.participant, "ros_discovery_info", ros_types.ParticipantEntitiesInfo)
        self.info = DataReader(self.participant, self.topic, qos=keep_all)
        self.endpoints = [
            (kind, BuiltinDataReader(self.participant, topic))
            for kind, topic in (("writes", BuiltinTopicDcpsPublication), ("reads", BuiltinTopicDcpsSubscription))
        ]
        self.told = {}
        self.seen = {}
        self.number = 0
        # As a node does, and as Cyclone DDS 11.0.1 needs it: once it crashed on a type that had just been given up.
        self.kept = []

    def look(self):
        for message in self.info.take(64):
            if dataclasses.is_dataclass(message):
                self.told[bytes(message.gid.data)] = message.node_entities_info_seq
        for kind, reader in self.endpoints:
            for one in reader.take(64):
                if getattr(one, "topic_name", None):
                    self.seen[one.key.bytes] = (kind, one.topic_name, one.type_name)

    def find(self, name):
        for nodes in self.told.values():
            for node in nodes:
                if f"{node.node_namespace.rstrip('/')}/{node.node_name}" == name:
                    return node
        return None

    def nodes(self, name, topic):
        while True:
            self.look()
            node = self.find(name)
            gids = [] if node is None else [bytes(gid.data) for gid in (*node.writer_gid_seq, *node.reader_gid_seq)]
            if all(gid in self.seen for gid in gids) and any(self.seen[gid][1] == topic for gid in gids):
                for gid in gids:
                    say(f"{name} {' '.join(self.seen[gid])}")
                say(f"node {name} is complete")
                return
            time.sleep(0.005)

    def gone(self, name):
        while True:
            self.look()
            if self.find(name) is None:
                say(f"node {name} is gone")
                return
            time.sleep(0.005)

    def call(self, node, service, request):
        ask, answer = ros_types.SERVICES[service]
        requests = Topic(self.participant, f"rq{node}/{service}Request", ask)
        replies = Topic(self.participant, f"rr{node}/{service}Reply", answer)
        reader = DataReader(self.participant, replies, qos=SERVICES)
        writer = DataWriter(self.participant, requests, qos=SERVICES)
        self.kept += [requests, replies, reader, writer]
        while not (writer.get_matched_subscriptions() and reader.get_matched_publications()):
            time.sleep(0.005)
        self.number += 1
        fields = json.loads(request)
        if "parameters" in fields:
            fields["parameters"] = [
                ros_types.Parameter(name, ros_types.ParameterValue(**value)) for name, value in fields["parameters"]
            ]
        writer.write(ask(ME, self.number, **fields))
        while True:
            for reply in reader.take(10):
                if isinstance(reply, answer) and (reply.guid, reply.seq) == (ME, self.number):
                    say(f"{service}: {as_json(reply)}")
                    return
            time.sleep(0.002)

    def hear(self, topic, type_name, count):
        qos = {"robot_description": LATCHED, "clock": BEST_EFFORT}.get(topic.rpartition("/")[2], SERVICES)
        cls = getattr(ros_types, type_name)
        heard = Topic(self.participant, f"rt/{topic}", cls)
        reader = DataReader(self.participant, heard, qos=qos)
        self.kept += [heard, reader]
        say(f"hears {topic}")
        left = int(count)
        while left:
            for message in reader.take(1):
                if isinstance(message, cls):
                    say(f"{topic}: {as_json(message)}")
                    left -= 1
            time.sleep(0.002)


def as_json(message):
    plain = {key: value for key, value in dataclasses.asdict(message).items() if key not in ("guid", "seq")}
    return json.dumps(plain)


def say(words):
    print(words, flush=True)


def main():
    node, words = Node(), sys.argv[1:]
    while words:
        do = words.pop(0)
        if do == "wait":
            wanted = words.pop(0)
            while sys.stdin.readline().strip() != wanted:
                pass
            continue
        arguments = [words.pop(0) for _ in range({"nodes": 2, "gone": 1}.get(do, 3))]
        getattr(node, do)(*arguments)
    say("done")


main()
