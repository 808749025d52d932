"""The mark of a blueprint: the same for robots that differ in nothing but their names."""

from __future__ import annotations

from dataclasses import replace

from msbot.config import SAMPLE_ROBOT_TOML, RobotProfile, blueprint_mark, load_library, parse_blueprint

SAMPLE = parse_blueprint(SAMPLE_ROBOT_TOML, load_library())


def test_names_order_and_places_do_not_count() -> None:
    same = replace(
        SAMPLE,
        robot=RobotProfile("OTHER", "2", "77"),
        library=("own",),
        slots=SAMPLE.slots[::-1],
        bindings=tuple(replace(one, targets=one.targets[::-1]) for one in SAMPLE.bindings[::-1]),
    )
    assert blueprint_mark(same) == blueprint_mark(SAMPLE)


def test_everything_else_counts() -> None:
    first = SAMPLE.slots[0]
    others = [
        replace(SAMPLE, slots=SAMPLE.slots[1:]),
        replace(SAMPLE, bindings=SAMPLE.bindings[1:]),
        replace(SAMPLE, slots=(replace(first, settings={"x": 1}), *SAMPLE.slots[1:])),
        replace(SAMPLE, timing=replace(SAMPLE.timing, life=SAMPLE.timing.life + 1)),
        replace(SAMPLE, options=replace(SAMPLE.options, authentication="key")),
    ]
    marks = {blueprint_mark(one) for one in (SAMPLE, *others)}
    assert len(marks) == 1 + len(others)
