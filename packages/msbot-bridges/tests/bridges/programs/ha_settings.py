"""A device made with ha-mqtt-discoverable that has a lamp and settings; one of them never reports what it is."""

from __future__ import annotations

import sys

import paho.mqtt.client as mqtt
from ha_mqtt_discoverable import DeviceInfo, Settings
from ha_mqtt_discoverable.sensors import (
    Number,
    NumberInfo,
    Select,
    SelectInfo,
    Switch,
    SwitchInfo,
)
from paho.mqtt.enums import CallbackAPIVersion

client = mqtt.Client(CallbackAPIVersion.VERSION2)
client.connect("127.0.0.1", int(sys.argv[1]))
client.loop_start()
device = DeviceInfo(name="Desk", manufacturer="ACME", model="desk", identifiers="s1")


def made(kind, info, name, told, **more):
    entity = info(name=name, unique_id=f"s1-{name}", device=device, **more)
    one = kind(Settings(mqtt=Settings.MQTT(host="127.0.0.1", client=client), entity=entity), told, retain=True)
    one.write_config()
    return one


def fade_told(client, user_data, message):
    print("fade", message.payload.decode(), flush=True)
    fade.set_value(float(message.payload))


def mode_told(client, user_data, message):
    print("mode", message.payload.decode(), flush=True)
    mode.select_option(message.payload.decode())


def loud_told(client, user_data, message):
    print("loud", message.payload.decode(), flush=True)


def nothing(client, user_data, message):
    pass


config = {"entity_category": "config"}
made(Switch, SwitchInfo, "lamp", nothing)
fade = made(Number, NumberInfo, "fade", fade_told, min=0, max=10, step=0.5, unit_of_measurement="s", **config)
mode = made(Select, SelectInfo, "mode", mode_told, options=["soft", "hard"], **config)
loud = made(Switch, SwitchInfo, "loud", loud_told, **config)
made(Number, NumberInfo, "silent", nothing, min=0, max=1, **config)
fade.set_value(1.5)
mode.select_option("soft")
loud.off()
print("ready", flush=True)
sys.stdin.read()
