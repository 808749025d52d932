"""Home Assistant's short names for the keys of a discovery message, as far as they matter here."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_SHORT: Mapping[str, str] = {
    "avty": "availability",
    "avty_mode": "availability_mode",
    "avty_t": "availability_topic",
    "avty_tpl": "availability_template",
    "bri_cmd_t": "brightness_command_topic",
    "bri_cmd_tpl": "brightness_command_template",
    "bri_scl": "brightness_scale",
    "bri_stat_t": "brightness_state_topic",
    "bri_val_tpl": "brightness_value_template",
    "cmd_t": "command_topic",
    "cmd_tpl": "command_template",
    "cmps": "components",
    "dev": "device",
    "dev_cla": "device_class",
    "ent_cat": "entity_category",
    "o": "origin",
    "obj_id": "object_id",
    "on_cmd_type": "on_command_type",
    "p": "platform",
    "pct_cmd_t": "percentage_command_topic",
    "pct_cmd_tpl": "percentage_command_template",
    "pct_stat_t": "percentage_state_topic",
    "pct_val_tpl": "percentage_value_template",
    "pl_avail": "payload_available",
    "pl_cls": "payload_close",
    "pl_not_avail": "payload_not_available",
    "pl_off": "payload_off",
    "pl_on": "payload_on",
    "pl_open": "payload_open",
    "pl_prs": "payload_press",
    "pl_stop": "payload_stop",
    "pos_clsd": "position_closed",
    "pos_open": "position_open",
    "pos_t": "position_topic",
    "pos_tpl": "position_template",
    "rgb_cmd_t": "rgb_command_topic",
    "rgb_stat_t": "rgb_state_topic",
    "rgb_val_tpl": "rgb_value_template",
    "set_pos_t": "set_position_topic",
    "set_pos_tpl": "set_position_template",
    "spd_rng_max": "speed_range_max",
    "spd_rng_min": "speed_range_min",
    "stat_clsd": "state_closed",
    "stat_closing": "state_closing",
    "stat_cla": "state_class",
    "stat_off": "state_off",
    "stat_on": "state_on",
    "stat_open": "state_open",
    "stat_opening": "state_opening",
    "stat_stopped": "state_stopped",
    "stat_t": "state_topic",
    "stat_val_tpl": "state_value_template",
    "sup_clrm": "supported_color_modes",
    "t": "topic",
    "uniq_id": "unique_id",
    "unit_of_meas": "unit_of_measurement",
    "val_tpl": "value_template",
}
_SHORT_OF_DEVICE: Mapping[str, str] = {
    "cns": "connections",
    "hw": "hw_version",
    "ids": "identifiers",
    "mdl": "model",
    "mdl_id": "model_id",
    "mf": "manufacturer",
    "sn": "serial_number",
    "sw": "sw_version",
}


def spelt_out(told: Mapping[str, Any]) -> dict[str, Any]:
    """A discovery message with long names, and with `~` in its topics replaced by what it stands for."""
    whole = {_SHORT.get(key, key): value for key, value in told.items()}
    base = whole.pop("~", None)
    if isinstance(base, str):
        whole = {key: _based(key, value, base) for key, value in whole.items()}
    device = whole.get("device")
    if isinstance(device, Mapping):
        whole["device"] = {_SHORT_OF_DEVICE.get(key, key): value for key, value in device.items()}
    availability = whole.get("availability")
    if isinstance(availability, Mapping):
        availability = [availability]
    if isinstance(availability, list):
        entries = [
            {_SHORT.get(key, key): value for key, value in one.items()}
            for one in availability
            if isinstance(one, Mapping)
        ]
        if isinstance(base, str):
            entries = [{key: _based(key, value, base) for key, value in one.items()} for one in entries]
        whole["availability"] = entries
    return whole


def _based(key: str, value: Any, base: str) -> Any:  # noqa: ANN401 - a value of JSON
    if not isinstance(value, str) or not (key == "topic" or key.endswith("_topic")):
        return value
    if value.startswith("~"):
        return base + value[1:]
    return value[:-1] + base if value.endswith("~") else value
