"""How the commands about blueprints show differences."""

from __future__ import annotations

from collections.abc import Sequence

from msbot.config import Blueprint, Difference


def empty_like(blueprint: Blueprint) -> Blueprint:
    """A robot of the same name without slots and wires, with which a new robot is compared."""
    return Blueprint(blueprint.robot, (), (), blueprint.timing, blueprint.options)


def plan_lines(differences: Sequence[Difference]) -> list[str]:
    """One line for each difference, and one that counts them."""
    count = {change: sum(difference.change == change for difference in differences) for change in _WORDS}
    summary = ", ".join(f"{number} {word}" for word, number in count.items() if number)
    return [*(f"  {difference}" for difference in differences), f"  {summary}."] if differences else []


_WORDS = ("added", "changed", "removed")


def as_json(differences: Sequence[Difference]) -> list[dict[str, str]]:
    """The same for programs."""
    return [
        {
            "change": difference.change,
            "where": difference.where,
            "before": difference.before,
            "after": difference.after,
            "consequence": difference.consequence,
        }
        for difference in differences
    ]
