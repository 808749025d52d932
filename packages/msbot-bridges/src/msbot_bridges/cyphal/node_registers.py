"""What a node's registers say of it: ports with their subjects, and settings. Pure; needs no library.

Registers are named values. `uavcan.pub.NAME.id` and `uavcan.sub.NAME.id` have the subject of each port, `.type` beside
them its data type; a name with `<`, `>` or `=` behind it has the highest, the lowest and the first value of a register.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from typing import Any, Final

from msbot_bridges.bridge import DeviceSetting
from msbot_bridges.cyphal.aspect import Aspect
from msbot_bridges.cyphal.port_types import TYPES
from msbot_bridges.cyphal.service_types import VECTORS
from msbot_xrce.lazy import dataclass

UNSET: Final = 0xFFFF
"""What a port has in its register that has no subject."""
LAST_SUBJECT: Final = 8191
_PORT: Final = re.compile(r"uavcan\.(pub|sub)\.([\w.]+)\.id", re.ASCII)
_PLACE: Final = re.compile(r"(?:[\w.]*[._])?(?:index|idx|esc_id|id_in_esc_group)", re.ASCII)
"""Registers with the place of a motor controller in the vector of its group: the standard has no name for them."""
_NUMBERS: Final = re.compile(r"(integer|natural|real)(8|16|32|64)")


@dataclass(frozen=True, slots=True)
class Register:
    """One register, as a node has told it."""

    kind: str
    """Which of the values of `uavcan.register.Value`: `natural16`, `string`."""
    values: tuple[Any, ...]
    """Its numbers, or its one text."""
    is_mutable: bool = True
    is_persistent: bool = True


@dataclass(frozen=True, slots=True)
class SubjectPort:
    """One port of a node."""

    name: str
    register: str
    """The name of the register with its subject."""
    type_name: str
    """Empty: the node does not say."""
    subject: int | None
    """None: it has none yet."""
    is_kept: bool
    """A subject that is written is there after a restart, too."""
    place: int | None = None
    """Of a vector: the element that is this node's; None: no register says so, or it is none of a group."""

    @property
    def places(self) -> int:
        """How many a vector of its type has; 0: it is none."""
        return VECTORS.get(self.type_name, 0)

    @property
    def is_usable(self) -> bool:
        """A node in a group has to say its place."""
        return not self.places or self.place is not None


@dataclass(frozen=True, slots=True)
class RegisterSetting:
    """A register that is a setting."""

    declared: DeviceSetting
    register: str
    kind: str


@dataclass(frozen=True, slots=True)
class NodePorts:
    """All ports of a node."""

    published: tuple[SubjectPort, ...]
    subscribed: tuple[SubjectPort, ...]


def ports_of(registers: Mapping[str, Register]) -> NodePorts:
    """The ports that the registers name, in their order."""
    found: dict[str, list[SubjectPort]] = {"pub": [], "sub": []}
    for name, register in registers.items():
        if (match := _PORT.fullmatch(name)) and register.kind == "natural16" and len(register.values) == 1:
            kind = registers.get(f"{name.removesuffix('.id')}.type")
            subject = int(register.values[0])
            type_name = str(kind.values[0]) if kind is not None and kind.kind == "string" else ""
            found[match[1]].append(
                SubjectPort(
                    match[2],
                    name,
                    type_name,
                    subject if subject <= LAST_SUBJECT else None,
                    register.is_mutable and register.is_persistent,
                    _place(registers, match[2], VECTORS.get(type_name, 0)),
                )
            )
    return NodePorts(tuple(found["pub"]), tuple(found["sub"]))


def _place(registers: Mapping[str, Register], port: str, places: int) -> int | None:
    """The place of a node in a vector; the register whose name begins as the port's does counts before others."""
    said = {
        name: int(register.values[0])
        for name, register in registers.items()
        if _PLACE.fullmatch(name) and re.match("integer|natural", register.kind) and len(register.values) == 1
    }
    stem = re.split(r"[._]", port)[0]
    fitting = [value for name, value in said.items() if name.startswith(stem)] or list(said.values())
    return fitting[0] if len(fitting) == 1 and 0 <= fitting[0] < places else None


def named_aspects(
    ports: Sequence[SubjectPort], taken: Collection[str], suffix: str = ""
) -> dict[SubjectPort, dict[str, Aspect]]:
    """The ports of a part that its node's ports are, by name; those whose data type is known here.

    Args:
        ports: the node's.
        taken: names that the part has already.
        suffix: what makes another name of a taken one; a name that is still taken is left out.
    """
    found: dict[SubjectPort, dict[str, Aspect]] = {}
    names = set(taken)
    for port in ports:
        for aspect in TYPES.get(port.type_name, ()) if port.is_usable else ():
            name = clean(port.name) + aspect.suffix
            name += suffix if name in names else ""
            if name not in names:
                names.add(name)
                found.setdefault(port, {})[name] = aspect
    return found


def settings_of(registers: Mapping[str, Register]) -> list[RegisterSetting]:
    """The registers that a person may set: those with one value, but for those of the standard."""
    found: dict[str, RegisterSetting] = {}
    is_in_group = any(port.places for port in ports_of(registers).subscribed)
    for name, register in registers.items():
        if is_in_group and _PLACE.fullmatch(name):
            continue  # the bridge drives it by that place
        if name.startswith("uavcan.") or not re.fullmatch(r"[a-z_][\w.]*", name, re.ASCII) or not register.is_mutable:
            continue
        setting = _setting(clean(name), name, register, registers)
        if setting is not None and setting.declared.name not in found:
            found[setting.declared.name] = setting
    return list(found.values())


def clean(name: str) -> str:
    """A name as ports and settings have them: without dots; programs have ports whose names are numbers."""
    return ("subject_" if name[:1].isdigit() else "") + name.replace(".", "_")


def _setting(name: str, of: str, register: Register, registers: Mapping[str, Register]) -> RegisterSetting | None:
    if len(register.values) != 1:
        return None
    value = _beside(registers, of, "=", register)
    value = register.values[0] if value is None else value
    if register.kind == "bit":
        return RegisterSetting(DeviceSetting(name, bool, bool(value)), of, register.kind)
    if register.kind == "string":
        return RegisterSetting(DeviceSetting(name, str, str(value)), of, register.kind)
    numbers = _NUMBERS.fullmatch(register.kind)
    if numbers is None:
        return None
    kind = float if numbers[1] == "real" else int
    least, most = _beside(registers, of, ">", register), _beside(registers, of, "<", register)
    if not math.isfinite(value):
        return None
    bits = int(numbers[2])
    if kind is int and bits < 64:
        lowest, highest = (0, (1 << bits) - 1) if numbers[1] == "natural" else (-(1 << bits - 1), (1 << bits - 1) - 1)
        least, most = lowest if least is None else least, highest if most is None else most
    declared = DeviceSetting(name, kind, kind(value), _number(least), _number(most))
    return RegisterSetting(declared, of, register.kind)


def _beside(registers: Mapping[str, Register], name: str, mark: str, like: Register) -> Any:  # noqa: ANN401
    """The one value of the register with that mark; None: there is none of the same kind."""
    other = registers.get(name + mark)
    return other.values[0] if other is not None and (other.kind, len(other.values)) == (like.kind, 1) else None


def _number(value: Any) -> float | None:  # noqa: ANN401
    return None if value is None else float(value)
