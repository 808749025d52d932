"""A topic of ROS 2 as it is on the wire, with the package `cyclonedds`.

ros_topic.py echo TOPIC        prints "got NUMBER" for each std_msgs/msg/Float32
ros_topic.py pub TOPIC NUMBER  publishes one again and again
"""

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
class Float32(IdlStruct, typename="std_msgs::msg::dds_::Float32_"):  # type: ignore[misc,call-arg]
    data: types.float32


def main(do: str, name: str, number: str = "0") -> None:
    participant = DomainParticipant(0)
    topic = Topic(participant, f"rt/{name}", Float32)
    qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(10))
    print("ready", flush=True)
    if do == "pub":
        writer = DataWriter(participant, topic, qos=qos)
        while True:
            writer.write(Float32(float(number)))
            time.sleep(0.05)
    reader = DataReader(participant, topic, qos=qos)
    while True:
        for message in reader.take(10):
            if isinstance(message, Float32):
                print(f"got {message.data:g}", flush=True)
        time.sleep(0.002)


main(*sys.argv[1:])
