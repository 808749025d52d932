"""Safe values as people write them: of a port in the part library, and of a slot's port in the blueprint."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping

from msbot.config.library.field_types import ListType, MessageType
from msbot.config.library.part_types import Port
from msbot_agent.text.sentence import said
from msbot_agent.toml.problems import suggestion
from msbot_agent.toml.table import Scalar, Table


def read_safe(table: Table, message: MessageType | None) -> dict[str, Scalar]:
    """The leaves of a safe value; what has fields inside may be a table, a list is one leaf.

    Args:
        table: field -> value.
        message: what the port takes; None: it is not known.
    """
    found: dict[str, Scalar] = {}
    for name in table.present_keys():
        value = table.item(name)
        kind = None if message is None else message.fields.get(name)
        if isinstance(value, dict) and isinstance(kind, MessageType):
            found |= {f"{name}.{way}": one for way, one in _flat(value)}
        elif isinstance(value, list) and isinstance(kind, ListType):
            found[name] = _list_text(value)
        elif isinstance(value, bool | int | float | str):
            found[name] = value
        else:
            table.scalar(name)
    return found


def safe_faults(port: Port, safe: Mapping[str, Scalar]) -> Iterator[tuple[str, str]]:
    """What is wrong with a safe value of a port that subscribes: pairs of a field and a sentence."""
    if port.message is None:
        return
    for name, value in safe.items():
        kind = port.message.leaves.get(name)
        if kind is None:
            right = suggestion(name, list(port.message.leaves), none_known=said("remove it"))
            yield name, said('a {type} has no field "{name}"; {right}', type=port.message.name, name=name, right=right)
        elif fault := kind.fault(value) or port.fault(name, value):
            yield name, fault


def _flat(values: Mapping[str, object]) -> Iterator[tuple[str, Scalar]]:
    for name, value in values.items():
        if isinstance(value, dict):
            yield from ((f"{name}.{way}", one) for way, one in _flat(value))
        elif isinstance(value, bool | int | float | str):
            yield name, value
        else:
            yield name, _list_text(value)


def _list_text(value: object) -> str:
    """A list as one leaf."""
    return json.dumps(value, default=str)
