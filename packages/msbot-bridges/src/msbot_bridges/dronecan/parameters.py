"""Parameters of nodes as settings: read once, written and kept, in the thread of their world."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any, Final

import dronecan
from dronecan import uavcan

from msbot_bridges.bridge import DeviceSetting

MOST_SETTINGS: Final = 60
"""Parameters read of one node; a description has no room for more."""
WRITE_TIMES: Final = 3
"""So often a parameter is written to a node that does not answer."""
SAVE_S: Final = 1.0
"""So long after the last change a node is told to keep its parameters: one memory cycle for all."""
_NEAR: Final = 1e-6
"""A node keeps real numbers in 32 bits."""
_log = logging.getLogger("msbot.part")


class NodeParameters:
    """Those of one node.

    Args:
        node: the bridge's own, of the library.
        node_id: where it is.
    """

    def __init__(self, node: Any, node_id: int) -> None:  # noqa: ANN401 - the library has no types
        self.settings: list[DeviceSetting] = []
        self.is_read = False
        """All of them are known."""
        self._node, self._node_id = node, node_id
        self._names = dict[str, str]()
        """As the node calls them, by the names of settings."""
        self._has = dict[str, object]()
        """What it has, as it has answered."""
        self._wanted = dict[str, object]()
        self._changes = 0
        self._is_gone = False

    def end(self) -> None:
        """The node is lost."""
        self._is_gone = True

    def read(self, index: int = 0) -> None:
        """Ask for all, one by one; a node that has no more answers with an empty name."""

        def answered(event: Any) -> None:  # noqa: ANN401
            if event is None or not event.response.name or index >= MOST_SETTINGS:
                self.is_read = True
                return
            setting = setting_of(event.response)
            if setting is not None and setting.name not in self._names:
                self._names[setting.name] = _text(event.response.name)
                self._has[setting.name] = _value_of(event.response.value)
                self.settings.append(setting)
            self.read(index + 1)

        if not self._is_gone:
            self._node.request(uavcan.protocol.param.GetSet.Request(index=index), self._node_id, answered)

    def write(self, name: str, value: object) -> None:
        """Give a setting its value; the node is told to keep it when it had another."""
        self._wanted[name] = value
        self._write(name, value, WRITE_TIMES)

    def _write(self, name: str, value: object, times: int) -> None:
        def answered(event: Any) -> None:  # noqa: ANN401
            if self._is_gone or self._wanted.get(name) != value:
                return  # another value was written since
            if event is None and times > 1:
                self._write(name, value, times - 1)
            elif event is None:
                _log.warning("node %d has not answered that its parameter %s is %s", self._node_id, name, value)
            else:
                self._answered(name, value, _value_of(event.response.value))

        request = uavcan.protocol.param.GetSet.Request(name=self._names.get(name, name))
        request.value = parameter_value(value)
        self._node.request(request, self._node_id, answered)

    def _answered(self, name: str, wanted: object, has: object) -> None:
        if not _is_same(wanted, has):
            _log.warning("node %d does not take %s for %s; it has %s", self._node_id, wanted, name, has)
        if not _is_same(has, self._has.get(name)):
            self._has[name] = has
            self._changes += 1
            self._node.defer(SAVE_S, self._saving(self._changes))

    def _saving(self, changes: int) -> Callable[[], None]:
        def answered(event: Any) -> None:  # noqa: ANN401
            if event is None or not event.response.ok:
                _log.warning(
                    "node %d does not say that it keeps its parameters: it may forget them when it restarts",
                    self._node_id,
                )

        def save() -> None:
            if self._is_gone or changes != self._changes:
                return
            request = uavcan.protocol.param.ExecuteOpcode.Request()
            request.opcode = request.OPCODE_SAVE
            self._node.request(request, self._node_id, answered)

        return save


def setting_of(answer: Any) -> DeviceSetting | None:  # noqa: ANN401
    """A parameter as a setting, with `_` for dots; None for one that no setting can be."""
    name = _text(answer.name).replace(".", "_")
    union = dronecan.get_active_union_field
    kind = union(answer.value)
    if not name.isprintable():
        return None
    default = answer.default_value if union(answer.default_value) == kind else answer.value
    if kind == "boolean_value":
        return DeviceSetting(name, bool, bool(default.boolean_value))
    if kind == "string_value":
        return DeviceSetting(name, str, _text(default.string_value))
    if kind not in ("integer_value", "real_value"):
        return None
    least, most = (
        float(getattr(limit, union(limit))) if union(limit) in ("integer_value", "real_value") else None
        for limit in (answer.min_value, answer.max_value)
    )
    if kind == "integer_value":
        return DeviceSetting(name, int, int(default.integer_value), least, most)
    return DeviceSetting(name, float, float(default.real_value), least, most)


def parameter_value(value: object) -> Any:  # noqa: ANN401
    """The value of a setting, as a node takes it."""
    made = uavcan.protocol.param.Value()
    if isinstance(value, bool):
        made.boolean_value = int(value)
    elif isinstance(value, int):
        made.integer_value = value
    elif isinstance(value, float):
        made.real_value = value
    else:
        made.string_value = str(value)
    return made


def _value_of(value: Any) -> object:  # noqa: ANN401
    match dronecan.get_active_union_field(value):
        case "boolean_value":
            return bool(value.boolean_value)
        case "integer_value":
            return int(value.integer_value)
        case "real_value":
            return float(value.real_value)
        case "string_value":
            return _text(value.string_value)
    return None


def _is_same(one: object, other: object) -> bool:
    if isinstance(one, float) and isinstance(other, float):
        return abs(one - other) <= _NEAR * max(1.0, abs(one))
    return one == other


def _text(array: Any) -> str:  # noqa: ANN401
    """A text of a node, whatever octets it has sent."""
    return bytes(array.to_bytes()).decode(errors="replace")
