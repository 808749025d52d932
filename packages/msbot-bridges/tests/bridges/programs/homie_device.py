"""A Homie 4 device whose messages homie-spec makes, in a process of its own: `mute` and `speak` on its input."""

from __future__ import annotations

import sys

import paho.mqtt.client as mqtt
from homie_spec import Device, Node, Property
from homie_spec.properties import Datatype
from paho.mqtt.enums import CallbackAPIVersion

port, name = int(sys.argv[1]), sys.argv[2]
state = {"power": "false", "level": "0", "warmth": "20.5"}
nodes = {
    "lamp": Node("Lamp", "light", {
        "power": Property("Power", lambda: state["power"], Datatype.BOOLEAN, settable=True),
        "level": Property("Level", lambda: state["level"], Datatype.INTEGER, settable=True, unit="%", formatOf="0:100"),
        "warmth": Property("Warmth", lambda: state["warmth"], Datatype.FLOAT, unit="°C"),
    }),
}  # fmt: skip
device = Device(name, "ACME lamp", nodes)
client = mqtt.Client(CallbackAPIVersion.VERSION2)
client.will_set(f"homie/{name}/$state", "lost", retain=True)
reports = True


def told(client, user_data, message):
    _, _, node, one, _ = message.topic.split("/")
    state[one] = message.payload.decode()
    print(one, state[one], flush=True)
    if reports:
        report(f"{node}/{one}")


def report(path):
    made = device.getter_message(path)
    client.publish(made.topic, made.payload, qos=made.qos, retain=made.retained)


client.on_message = told
client.connect("127.0.0.1", port)
client.loop_start()
client.subscribe(f"homie/{name}/+/+/set")
for made in device.messages():
    client.publish(made.topic, made.payload, qos=made.qos, retain=made.retained)
for one in state:
    report(f"lamp/{one}")
print("ready", flush=True)
for line in sys.stdin:
    reports = line.strip() == "speak"
    print("done", flush=True)
