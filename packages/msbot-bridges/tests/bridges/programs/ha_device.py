"""A device made with ha-mqtt-discoverable, in a process of its own: a lamp, a heater that reports its power, a probe.

It is told by lines on its input: `mute` and `speak` (whether it reports what it is told), `warm NUMBER`, `end`.
"""

from __future__ import annotations

import json
import sys

import paho.mqtt.client as mqtt
from ha_mqtt_discoverable import DeviceInfo, Settings
from ha_mqtt_discoverable.sensors import (
    BinarySensor,
    BinarySensorInfo,
    Light,
    LightInfo,
    Number,
    NumberInfo,
    Sensor,
    SensorInfo,
    Switch,
    SwitchInfo,
)
from paho.mqtt.enums import CallbackAPIVersion

port, serial = int(sys.argv[1]), sys.argv[2]
client = mqtt.Client(CallbackAPIVersion.VERSION2)
available = f"hmd/{serial}/available"
client.will_set(available, "offline", retain=True)
client.connect("127.0.0.1", port)
client.loop_start()
reports = True
device = DeviceInfo(name=f"Desk {serial}", manufacturer="ACME", model="desk", identifiers=serial, sw_version="1.2")


def settings(entity):
    return Settings(mqtt=Settings.MQTT(host="127.0.0.1", port=port, client=client), entity=entity)


def with_availability(made):
    """The library gives each entity a topic of its own; devices mostly have one for all."""
    plain = made.generate_config
    made.generate_config = lambda: plain() | {"availability_topic": available}
    made.write_config()
    return made


def lamp_told(client, user_data, message):
    told = json.loads(message.payload)
    print("lamp", json.dumps(told, sort_keys=True), flush=True)
    if not reports:
        return
    lamp.off() if told["state"] == "OFF" else lamp.brightness(told.get("brightness", 255))


def heater_told(client, user_data, message):
    print("heater", message.payload.decode(), flush=True)
    heater.set_value(float(message.payload))


def relay_told(client, user_data, message):
    print("relay", message.payload.decode(), flush=True)
    relay.on() if message.payload == b"ON" else relay.off()


lamp_info = LightInfo(
    name="lamp",
    unique_id=f"{serial}-lamp",
    device=device,
    brightness=True,
    color_mode=True,
    supported_color_modes=["brightness"],
)
lamp = Light(settings(lamp_info), lamp_told, retain=True)
heater_info = NumberInfo(
    name="heater", unique_id=f"{serial}-heater", device=device, min=0, max=100, unit_of_measurement="%"
)
heater = Number(settings(heater_info), heater_told, retain=True)
relay = Switch(settings(SwitchInfo(name="relay", unique_id=f"{serial}-relay", device=device)), relay_told)
probe_info = SensorInfo(
    name="probe", unique_id=f"{serial}-probe", device=device, unit_of_measurement="°C", device_class="temperature"
)
probe = Sensor(settings(probe_info), retain=True)
door = BinarySensor(
    settings(BinarySensorInfo(name="door", unique_id=f"{serial}-door", device=device, device_class="door")), retain=True
)
for one in (lamp, heater, relay, probe, door):
    with_availability(one)
lamp.off()
heater.set_value(0)
probe.set_state(21.5)
door.off()
client.publish(available, "online", retain=True)
print("ready", flush=True)
for line in sys.stdin:
    word, _, rest = line.strip().partition(" ")
    if word in ("mute", "speak"):
        reports = word == "speak"
    elif word == "warm":
        probe.set_state(float(rest))
    elif word == "end":
        break
    print("done", flush=True)
