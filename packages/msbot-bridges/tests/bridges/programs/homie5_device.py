"""A Homie 5 device made with ebus-sdk, in a process of its own: an arm with an angle, a gripper and a setting."""

from __future__ import annotations

import sys

from ebus_sdk import Device, PropertyDatatype, Unit

device = Device(
    "arm1",
    name="Arm",
    type="acme-arm",
    homie_domain="homie",
    mqtt_cfg={"host": "127.0.0.1", "port": int(sys.argv[1])},
)


def add(node, name, datatype, value, **more):
    def told(payload):
        print(name, payload, flush=True)
        made.set_value(payload == "true" if isinstance(value, bool) else type(value)(payload))

    described = {"id": name, "name": name, "datatype": datatype, "set_callback": told, **more}
    made = node.add_property_from_dict(described)
    made.set_value(value)


joint = device.add_node_from_dict({"id": "joint", "name": "Joint", "type": "joint"})
add(joint, "angle", PropertyDatatype.FLOAT, 0.0, format="-90:90", unit=Unit.DEGREE, settable=True)
add(joint, "gripper", PropertyDatatype.BOOLEAN, False, settable=True)
add(joint, "warmth", PropertyDatatype.FLOAT, 21.5, unit=Unit.DEGREE_CELSIUS)
settings = device.add_node_from_dict({"id": "settings", "name": "Settings", "type": "settings"})
add(settings, "speed", PropertyDatatype.INTEGER, 40, format="1:100", unit=Unit.PERCENT, settable=True)
device.start_mqtt_client()
print("ready", flush=True)
sys.stdin.read()
