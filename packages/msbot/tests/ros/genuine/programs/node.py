"""A genuine node of ROS 2 that does what it is told: a line of JSON in, a line of JSON out.

It runs with the Python of its own environment, and imports nothing of MsBOT.
"""

import importlib
import json
import os
import re
import sys
import threading
import time
from itertools import cycle

import rclpy
from mcap.reader import make_reader
from rclpy.action import ActionClient, ActionServer
from rclpy.executors import MultiThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Timer

GENEROUS_S = 60.0
# A node of ours is told that nobody answers after this time, and nothing that works takes so long.


def main(name: str, namespace: str = "/") -> None:
    rclpy.init()
    node = rclpy.create_node(name, namespace=namespace)
    executor = MultiThreadedExecutor(4)
    executor.add_node(node)
    threading.Thread(target=executor.spin, daemon=True).start()
    does = Does(node)
    say({"ready": node.get_fully_qualified_name(), "rmw": rclpy.get_rmw_implementation_identifier()})
    for line in sys.stdin:
        wish = json.loads(line)
        try:
            number, do = wish.pop("id"), wish.pop("do")
            say({"id": number, "answer": getattr(does, do)(**wish)})
        except TimeoutError as error:
            say({"id": number, "failed": str(error)})


class Does:
    """What can be asked of the node."""

    def __init__(self, node) -> None:
        self.node = node
        self.kept = []
        self.heard = {}
        self.publishers_of = {}

    def forget(self):
        """Take back all that was asked for."""
        for one in self.kept:
            destroy = {
                ActionServer: lambda: one.destroy(),
                Subscription: lambda: self.node.destroy_subscription(one),
                Publisher: lambda: self.node.destroy_publisher(one),
                Service: lambda: self.node.destroy_service(one),
                Timer: lambda: self.node.destroy_timer(one),
            }.get(type(one))
            if destroy is not None:
                destroy()
        self.kept.clear()
        self.heard.clear()
        self.publishers_of.clear()

    def call(self, type, name, request, times=1):
        kind = class_of(type)
        client = self.node.create_client(kind, name)
        if not client.wait_for_service(GENEROUS_S):
            raise TimeoutError(f"there is no service {name}")
        took = []
        for _ in range(times):
            begun = time.perf_counter()
            answer = wait(client.call_async(filled(kind.Request(), request)), name)
            took.append(time.perf_counter() - begun)
        self.node.destroy_client(client)
        return {"response": plain(answer), "median_ms": 1e3 * sorted(took)[len(took) // 2]}

    def serve(self, type, name, reply=None):
        """A service that answers with that, else with true and what it was asked."""

        def answer(request, response):
            return filled(response, reply or {"success": True, "message": json.dumps(plain(request))})

        self.kept.append(self.node.create_service(class_of(type), name, answer))

    def send_goal(self, type, name, goal, times=1):
        kind = class_of(type)
        client = ActionClient(self.node, kind, name)
        if not client.wait_for_server(GENEROUS_S):
            raise TimeoutError(f"there is no action {name}")
        feedback, took = [], []
        for _ in range(times):
            begun = time.perf_counter()
            sent = client.send_goal_async(filled(kind.Goal(), goal), lambda one: feedback.append(plain(one.feedback)))
            handle = wait(sent, name)
            result = wait(handle.get_result_async(), name)
            took.append(time.perf_counter() - begun)
        client.destroy()
        return {
            "median_ms": 1e3 * sorted(took)[len(took) // 2],
            "accepted": handle.accepted,
            "status": result.status,
            "result": plain(result.result),
            "feedback": feedback,
        }

    def serve_action(self, type, name):
        kind = class_of(type)

        def carry_out(handle):
            sequence = [0, 1]
            while len(sequence) <= handle.request.order:
                sequence.append(sequence[-1] + sequence[-2])
                handle.publish_feedback(filled(kind.Feedback(), {"sequence": sequence}))
            handle.succeed()
            return filled(kind.Result(), {"sequence": sequence})

        self.kept.append(ActionServer(self.node, kind, name, carry_out))

    def listen(self, type, name, reliable=True, late=False, depth=10):
        came = self.heard[name] = []
        self.kept.append(
            self.node.create_subscription(
                class_of(type), name, lambda one: came.append(plain(one)), qos(reliable, late, depth)
            )
        )

    def came(self, name, number=1):
        deadline = time.monotonic() + GENEROUS_S
        while len(self.heard[name]) < number:
            if time.monotonic() > deadline:
                raise TimeoutError(f"{name}: {self.heard[name]}")
            time.sleep(0.005)
        return self.heard[name]

    def came_so_far(self, name):
        return self.heard[name]

    def publish(self, type, name, messages, reliable=True, late=False, period_s=None, depth=10, until=0):
        """Publish these, at once or one after the other with a period; first wait for so many readers."""
        kind = class_of(type)
        publisher = self.publishers_of.get(name)
        if publisher is None:
            publisher = self.publishers_of[name] = self.node.create_publisher(kind, name, qos(reliable, late, depth))
            self.kept.append(publisher)
        self._wait_for_readers(publisher, until)
        messages = [filled(kind(), one) for one in messages]
        if period_s is None:
            for one in messages:
                publisher.publish(one)
        else:
            rest = cycle(messages)
            self.kept.append(self.node.create_timer(period_s, lambda: publisher.publish(next(rest))))

    def ping(self, there, back, times):
        """How long a number takes to somebody who sends it back, and back: the median."""
        kind = class_of("std_msgs/msg/Int32")
        came = threading.Event()
        publisher = self.node.create_publisher(kind, there, 10)
        self.kept += [publisher, self.node.create_subscription(kind, back, lambda _: came.set(), 10)]
        self._wait_for_readers(publisher, 1)
        took = []
        while len(took) < times:
            begun = time.perf_counter()
            publisher.publish(kind(data=len(took)))
            if came.wait(1.0):
                took.append(time.perf_counter() - begun)
            came.clear()
        return {"median_ms": 1e3 * sorted(took)[times // 2]}

    def play(self, file, topic, until=0):
        """As `ros2 bag play` does: the octets in the bag, by the names of topic and type in it, in its order."""
        played = 0
        with open(file, "rb") as stream:
            for schema, channel, message in make_reader(stream).iter_messages(topics=[topic]):
                publisher = self.publishers_of.get(channel.topic)
                if publisher is None:
                    publisher = self.publishers_of[channel.topic] = self.node.create_publisher(
                        class_of(schema.name), channel.topic, 10
                    )
                    self.kept.append(publisher)
                    self._wait_for_readers(publisher, until)
                publisher.publish(message.data)
                played += 1
        return played

    def _wait_for_readers(self, publisher, wanted):
        deadline = time.monotonic() + GENEROUS_S
        while publisher.get_subscription_count() < wanted:
            if time.monotonic() > deadline:
                raise TimeoutError(f"{publisher.topic_name}: {publisher.get_subscription_count()} readers")
            time.sleep(0.005)

    def nodes(self, wanted=()):
        """The nodes, once those are there."""
        deadline = time.monotonic() + GENEROUS_S
        while True:
            found = sorted(f"{space.rstrip('/')}/{name}" for name, space in self.node.get_node_names_and_namespaces())
            if set(wanted) <= set(found) or time.monotonic() > deadline:
                return found
            time.sleep(0.01)

    def gone(self, names):
        """Wait until none of these nodes is there."""
        deadline = time.monotonic() + GENEROUS_S
        while set(names) & set(self.nodes()):
            if time.monotonic() > deadline:
                raise TimeoutError(f"still there: {self.nodes()}")
            time.sleep(0.01)

    def service_gone(self, name):
        """Wait until nobody serves it: a request to who has just left is lost in ROS 2."""
        deadline = time.monotonic() + GENEROUS_S
        while name in dict(self.node.get_service_names_and_types()):
            if time.monotonic() > deadline:
                raise TimeoutError(f"{name} is still served")
            time.sleep(0.01)

    def topics(self):
        return dict(self.node.get_topic_names_and_types())

    def services_of(self, name, namespace):
        """What a node serves, once it is there."""
        self.nodes([f"{namespace.rstrip('/')}/{name}"])
        return dict(self.node.get_service_names_and_types_by_node(name, namespace))

    def publishers(self, name, wanted=1):
        return self._ends(self.node.get_publishers_info_by_topic, name, wanted)

    def service_ends(self, name):
        """The hashes of all who read the requests of a service or write its replies: once both are there."""
        deadline = time.monotonic() + GENEROUS_S
        while True:
            ends = [
                self.node.get_subscriptions_info_by_topic(f"rq{name}Request", no_mangle=True),
                self.node.get_publishers_info_by_topic(f"rr{name}Reply", no_mangle=True),
            ]
            if all(ends) or time.monotonic() > deadline:
                return [{"type": one.topic_type, "hash": str(one.topic_type_hash)} for found in ends for one in found]
            time.sleep(0.01)

    def subscriptions(self, name, wanted=1):
        return self._ends(self.node.get_subscriptions_info_by_topic, name, wanted)

    def _ends(self, ask, name, wanted):
        deadline = time.monotonic() + GENEROUS_S
        while len(found := ask(name)) < wanted and time.monotonic() < deadline:
            time.sleep(0.01)
        return [
            {
                "node": f"{one.node_namespace.rstrip('/')}/{one.node_name}",
                "type": one.topic_type,
                "hash": str(one.topic_type_hash),
                "reliable": one.qos_profile.reliability == ReliabilityPolicy.RELIABLE,
                "late": one.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL,
            }
            for one in found
        ]

    def parameters(self, names):
        """As `ros2 param list`: it waits for all parameter services of each node, and then asks it."""
        asked = {name: self._parameters(name) for name in names}
        return {name: sorted(wait(client.list_parameters(), name).result.names) for name, client in asked.items()}

    def get_parameters(self, name, names):
        """As `ros2 param get`."""
        return [plain(value) for value in wait(self._parameters(name).get_parameters(names), name).values]

    def set_parameters(self, name, values):
        """As `ros2 param set`."""
        wanted = [Parameter(key, value=value) for key, value in values.items()]
        return [plain(one) for one in wait(self._parameters(name).set_parameters(wanted), name).results]

    def set_parameters_atomically(self, name, values):
        """All or none, in one request."""
        wanted = [Parameter(key, value=value) for key, value in values.items()]
        return plain(wait(self._parameters(name).set_parameters_atomically(wanted), name).result)

    def _parameters(self, name):
        client = AsyncParameterClient(self.node, name)
        self.kept.append(client)
        if not client.wait_for_services(GENEROUS_S):
            raise TimeoutError(f"{name} has no parameter services")
        return client


def qos(reliable, late, depth=10):
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if late else DurabilityPolicy.VOLATILE,
    )


def wait(future, what):
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    if not done.wait(GENEROUS_S):
        raise TimeoutError(f"{what} does not answer")
    return future.result()


def class_of(name):
    package, kind, name = name.split("/")
    return getattr(importlib.import_module(f"{package}.{kind}"), name)


def plain(value):
    """A message as JSON has it."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):
        return list(value)
    if isinstance(value, (str, bool, int, float)):
        return value
    return [plain(one) for one in value]


def filled(message, values):
    for name, value in values.items():
        if isinstance(value, dict):
            value = filled(getattr(message, name), value)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            package, kind = re.search(r"(\w+)/(\w+)", message.get_fields_and_field_types()[name]).groups()
            value = [filled(class_of(f"{package}/msg/{kind}")(), one) for one in value]
        setattr(message, name, value)
    return message


def say(what):
    os.write(1, json.dumps(what).encode() + b"\n")  # whole lines, whatever ROS 2 says in between


main(*sys.argv[1:])
