"""Reads and writes the registers of a node, with the library."""

from __future__ import annotations

import math
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, Final

import pycyphal.application
import uavcan.node
import uavcan.primitive.array
import uavcan.register
from pycyphal.transport import Priority

from msbot_bridges.bridge import Value
from msbot_bridges.cyphal.node_registers import Register

TIMES: Final = 3
"""So often a node that does not answer is asked."""
MOST_REGISTERS: Final = 250
RESTART: Final = uavcan.node.ExecuteCommand_1_3.Request.COMMAND_RESTART
STORE: Final = uavcan.node.ExecuteCommand_1_3.Request.COMMAND_STORE_PERSISTENT_STATES
BEGIN_SOFTWARE_UPDATE: Final = uavcan.node.ExecuteCommand_1_3.Request.COMMAND_BEGIN_SOFTWARE_UPDATE
IDENTIFY: Final = uavcan.node.ExecuteCommand_1_3.Request.COMMAND_IDENTIFY


class RegisterAccess:
    """The registers of all nodes.

    Args:
        node: the bridge's own.
    """

    def __init__(self, node: pycyphal.application.Node) -> None:
        self._node = node

    async def info(self, node_id: int) -> Any:  # noqa: ANN401
        """The answer to GetInfo: who a node is; None: there is none."""
        async with self._client(uavcan.node.GetInfo_1, node_id) as ask:
            return await _ask(ask, uavcan.node.GetInfo_1.Request())

    async def read_all(self, node_id: int) -> dict[str, Register] | None:
        """All registers of a node, by name; None: it has stopped answering."""
        found: dict[str, Register] = {}
        async with self._client(uavcan.register.List_1, node_id) as ask_name:
            for index in range(MOST_REGISTERS):
                answer = await _ask(ask_name, uavcan.register.List_1.Request(index))
                if answer is None:
                    return None if index else {}  # a node may have no registers at all
                name = bytes(answer.name.name).decode(errors="replace")
                if not name:
                    break
                register = await self.read(node_id, name)
                if register is None:
                    return None
                found[name] = register
        return found

    async def read(self, node_id: int, name: str) -> Register | None:
        """One register; None: no answer."""
        return await self._access(node_id, name, uavcan.register.Value_1())

    async def write(self, node_id: int, name: str, kind: str, value: Value) -> Register | None:
        """Write one register of a node; what it has then. None: no answer.

        Args:
            node_id: the node.
            name: of the register.
            kind: see `Register.kind`.
            value: its one value.
        """
        made = uavcan.register.Value_1()
        if kind == "string":
            made.string = uavcan.primitive.String_1(str(value).encode())
        else:
            setattr(made, kind, getattr(uavcan.primitive.array, f"{kind.capitalize()}_1")([value]))
        return await self._access(node_id, name, made)

    async def command(self, node_id: int, command: int) -> bool:
        """Have a node carry out a standard command; False: it does not, or does not answer."""
        answer = await self.ask_command(node_id, command)
        return answer is not None and bool(answer.status == answer.STATUS_SUCCESS)

    async def ask_command(self, node_id: int, command: int, parameter: str = "") -> Any:  # noqa: ANN401
        """The answer of a node to a standard command; None: there is none."""
        async with self._client(uavcan.node.ExecuteCommand_1_3, node_id) as ask:
            return await _ask(ask, uavcan.node.ExecuteCommand_1_3.Request(command, list(parameter.encode())))

    async def _access(self, node_id: int, name: str, value: Any) -> Register | None:  # noqa: ANN401
        async with self._client(uavcan.register.Access_1, node_id) as ask:
            answer = await _ask(ask, uavcan.register.Access_1.Request(uavcan.register.Name_1(name), value))
            return None if answer is None else _register(answer)

    @asynccontextmanager
    async def _client(self, service: Any, node_id: int) -> AsyncIterator[Any]:  # noqa: ANN401
        client = self._node.make_client(service, node_id)
        client.priority = Priority.LOW
        try:
            yield client
        finally:
            client.close()


async def _ask(client: Any, request: Any) -> Any:  # noqa: ANN401
    """The answer; None: there is none."""
    for _ in range(TIMES):
        answered = await client.call(request)
        if answered is not None:
            return answered[0]
    return None


def _register(answer: Any) -> Register:  # noqa: ANN401
    value = answer.value
    kinds = (
        *("string", "unstructured", "bit"),
        *(f"{kind}{bits}" for kind in ("integer", "natural") for bits in (8, 16, 32, 64)),
        *("real16", "real32", "real64"),
    )
    kind = next((one for one in kinds if getattr(value, one) is not None), "empty")
    inside = getattr(value, kind)
    if kind == "string":
        values: tuple[Any, ...] = (bytes(inside.value).decode(errors="replace"),)
    else:
        # The shortest number that is the same in so many bits: 0.1, not 0.10000000149.
        number = (lambda one: float(str(one))) if kind.startswith("real") else (lambda one: one.item())
        values = () if kind == "empty" else tuple(map(number, inside.value))
    return Register(kind, values, bool(answer.mutable), bool(answer.persistent))


def is_as_written(register: Register, value: Value) -> bool:
    """Whether a register has the value that was written, as exactly as its kind can."""
    if len(register.values) != 1:
        return False
    has = register.values[0]
    if isinstance(value, str) or isinstance(has, str):
        return bool(has == value)
    return math.isclose(float(has), float(value), rel_tol=1e-3, abs_tol=1e-9)
