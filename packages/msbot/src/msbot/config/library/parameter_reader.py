"""Reads what can be configured about a part: its parameters, and the options of its driver."""

from __future__ import annotations

from msbot.config.library.part_types import Parameter, ParameterKind
from msbot_agent.toml.table import Table

FORBIDDEN_IN_NAMES = "."
"""In a part's settings a dot marks what is none of its parameters: safe values, STOP."""


def read_parameter(table: Table) -> Parameter:
    """Read one table that describes a parameter or option."""
    kind = ParameterKind(table.choice("type", [kind.value for kind in ParameterKind]))
    if "default" not in table:
        table.problem("is missing; add the value that holds when nobody sets another", "default")
    default = table.scalar("default")
    parameter = Parameter(
        name=table.name("name", "period_s", forbidden=FORBIDDEN_IN_NAMES),
        kind=kind,
        default="" if default is None else default,
        unit=table.text("unit", "s"),
        least=_limit(table, "min", kind),
        most=_limit(table, "max", kind),
        description=table.text("description", "Time between two measurements"),
    )
    table.finish()
    if default is not None and (fault := parameter.fault(default)):
        table.problem(fault, "default")
    return parameter


def _limit(table: Table, key: str, kind: ParameterKind) -> float | None:
    if key not in table:
        return None
    if kind not in (ParameterKind.INT, ParameterKind.FLOAT):
        table.problem("only a parameter of type int or float has limits; remove it", key)
    return table.number(key, default=0.0, least=-1e300, most=1e300)


def check_twice(table: Table, key: str, names: list[str]) -> None:
    """Note every name that occurs a second time."""
    for position, name in enumerate(names):
        if name and name in names[:position]:
            table.problem(f'there are two with the name "{name}"; give each its own', key, position, "name")
