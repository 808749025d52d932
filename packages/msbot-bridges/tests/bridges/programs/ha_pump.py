"""A pump made with ha-mqtt-discoverable, with the port and the setting of the pump with Modbus of the examples."""

from __future__ import annotations

import sys

import paho.mqtt.client as mqtt
from ha_mqtt_discoverable import DeviceInfo, Settings
from ha_mqtt_discoverable.sensors import Number, NumberInfo
from paho.mqtt.enums import CallbackAPIVersion

client = mqtt.Client(CallbackAPIVersion.VERSION2)
client.connect("127.0.0.1", int(sys.argv[1]))
client.loop_start()
device = DeviceInfo(name="Other pump", manufacturer="Other", model="pump", identifiers="p1")
made = {}


def number(name, start, **more):
    def told(client, user_data, message):
        print(name, message.payload.decode(), flush=True)
        made[name].set_value(float(message.payload))

    entity = NumberInfo(name=name, unique_id=f"p1-{name}", device=device, **more)
    made[name] = Number(Settings(mqtt=Settings.MQTT(host="127.0.0.1", client=client), entity=entity), told, retain=True)
    made[name].write_config()
    made[name].set_value(start)


number("speed", 0.0, min=0, max=2000, step=1, unit_of_measurement="rpm")
number("ramp", 3.0, min=0.5, max=30, step=0.5, unit_of_measurement="s", entity_category="config")
print("ready", flush=True)
sys.stdin.read()
