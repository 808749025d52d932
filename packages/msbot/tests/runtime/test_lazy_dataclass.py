"""Dataclasses that compile their methods late behave as Python's own do."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import pickle
from collections.abc import Callable
from dataclasses import FrozenInstanceError, field
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot_xrce.lazy import dataclass
from tests.effort import tries

KINDS = (
    "needed",
    "default",
    "made",
    "left out, default",
    "left out, made",
    "by name only",
    "not compared",
    "not shown",
)
EXTRAS: dict[str, Callable[..., object]] = {
    "__post_init__": lambda self: object.__setattr__(self, "first", ("seen", self.first)),
    "__repr__": lambda self: f"one of {len(dataclasses.fields(self))}",
    "__eq__": lambda self, other: self is other,
    "__hash__": lambda self: 7,
}

QUESTIONS: tuple[Callable[[Any], object], ...] = (
    repr,
    dataclasses.asdict,
    lambda one: hash(one) if "__hash__" in vars(type(one)) else "by place",
    lambda one: repr(dataclasses.replace(one, first=1)),
    lambda one: repr(copy.copy(one)),
    lambda one: repr(copy.deepcopy(one)),
)
CHANGES: tuple[Callable[[Any], object], ...] = (
    lambda one: (setattr(one, "first", 5), one.first),  # type: ignore[func-returns-value]
    lambda one: (set_beside(one), getattr(one, "beside", None)),  # type: ignore[func-returns-value]
    lambda one: delattr(one, "first"),
)
"""What is left of one after them is of no use."""


def set_beside(one: Any) -> None:
    """Set what is no field; Python's own fall over their own feet there if they are frozen and have slots."""
    if not (hasattr(one, "__slots__") and "__setattr__" in vars(type(one))):
        one.beside = 5


def made(decorator: Any, kinds: list[str], extras: list[str], options: dict[str, bool]) -> type:
    """A class of these fields: `first`, then one for each kind."""
    body: dict[str, Any] = {"__annotations__": {"first": "object"}, "__doc__": "One.", "__module__": __name__}
    body["__qualname__"] = "One"
    for number, kind in enumerate(kinds):
        name = f"f{number}"
        body["__annotations__"][name] = "object"
        if kind != "needed":
            body[name] = {
                "default": field(default=number),
                "made": field(default_factory=list),
                "left out, default": field(init=False, default=number),
                "left out, made": field(init=False, default_factory=dict),
                "by name only": field(kw_only=True),
                "not compared": field(default=0, compare=False),
                "not shown": field(default=0, repr=False),
            }[kind]
    body |= {name: EXTRAS[name] for name in extras}
    found: type = decorator(**options)(type("One", (), body))
    return found


def outcome(call: Callable[[], object]) -> object:
    """What a call gives, or what its error says."""
    try:
        return call()
    except (TypeError, AttributeError) as error:
        return type(error), str(error)


@settings(max_examples=tries(60, 2000), deadline=None)
@given(
    st.lists(st.sampled_from(KINDS), max_size=5),
    st.lists(st.sampled_from(sorted(EXTRAS)), unique=True),
    st.fixed_dictionaries({}, optional={"frozen": st.booleans(), "slots": st.booleans(), "eq": st.booleans()}),
    st.lists(st.integers(0, 2), max_size=7),
    st.dictionaries(st.sampled_from(["first", "f0", "f1", "f2", "wrong"]), st.integers(0, 2), max_size=4),
    st.lists(st.integers(0, 2), max_size=7),
)
def test_it_does_what_the_plain_ones_do(
    kinds: list[str],
    extras: list[str],
    options: dict[str, bool],
    values: list[int],
    named: dict[str, int],
    others: list[int],
) -> None:
    kinds.sort(key=lambda kind: kind != "needed")  # those without a default come first
    late, plain = (made(decorator, kinds, extras, options) for decorator in (dataclass, dataclasses.dataclass))
    assert vars(late)["__match_args__"] == vars(plain)["__match_args__"]
    assert hasattr(late, "__slots__") is hasattr(plain, "__slots__")
    assert str(inspect.signature(late)) == str(inspect.signature(plain))
    alike = [
        [outcome(lambda of=of, given=given, by=by: of(*given, **by)) for of in (late, plain)]  # type: ignore[misc]
        for given, by in ((values, named), (values, named), (others, {}))
    ]
    for ours, theirs in alike:
        if not isinstance(theirs, plain):
            assert ours == theirs
            continue
        assert isinstance(ours, late)
        assert vars(late).keys() >= vars(plain).keys() - {"__dataclass_params__"}
        for ask in QUESTIONS:
            said = [outcome(lambda one=one, ask=ask: ask(one)) for one in (ours, theirs)]  # type: ignore[misc]
            assert said[0] == said[1]
    found = [pair for pair in alike if isinstance(pair[1], plain)]
    for ours, theirs in found:
        assert [ours == one for one, _ in found] == [theirs == one for _, one in found]
        assert ours != theirs
        assert ours != object()
    for ours, theirs in found:
        for change in CHANGES:
            said = [outcome(lambda one=one, change=change: change(one)) for one in (ours, theirs)]  # type: ignore[misc]
            assert said[0] == said[1]


@dataclass(frozen=True, slots=True)
class Base:
    """With a value."""

    value: int = 0


@dataclass(frozen=True, slots=True)
class Above(Base):
    """With another one."""

    other: str = "x"


def test_classes_stand_on_each_other_and_are_kept_and_sent() -> None:
    one = Above(1, "y")
    assert repr(one) == "Above(value=1, other='y')"
    assert pickle.loads(pickle.dumps(one)) == one
    assert Base(1) != one
    assert {one: 1}[Above(1, "y")] == 1
    match one:
        case Above(value, other):
            assert (value, other) == (1, "y")
    with pytest.raises(FrozenInstanceError):
        one.value = 2  # type: ignore[misc]


def test_frozen_and_not_frozen_do_not_mix() -> None:
    with pytest.raises(TypeError, match="Loose is not frozen and its base Base is frozen"):

        @dataclass(slots=True)
        class Loose(Base):  # type: ignore[misc]
            more: int = 0


def test_a_mutable_default_is_refused() -> None:
    with pytest.raises(ValueError, match="mutable default"):

        @dataclass
        class Shared:
            values: list[int] = []  # noqa: RUF012


def test_methods_are_compiled_once_and_at_first_use() -> None:
    @dataclass(slots=True)
    class Late:
        value: int

    waiting = Late.__init__
    assert Late(1).value == 1
    compiled = Late.__init__
    assert compiled is not waiting
    assert Late(2) == Late(2)
    assert Late.__init__ is compiled
    assert compiled.__qualname__.endswith("Late.__init__")
    with pytest.raises(TypeError, match=r"Late.__init__\(\) missing 1 required positional argument: 'value'"):
        Late()  # type: ignore[call-arg]


def test_a_signature_is_that_of_the_fields_also_where_a_class_stands_on_one() -> None:
    class Child(Above):
        """Made as its base is."""

    class Own(Above):
        """Made in its own way."""

        def __init__(self, word: str) -> None:
            super().__init__(len(word), word)

    for _ in range(2):  # before its methods are compiled, and after
        assert [str(inspect.signature(each)) for each in (Above, Child, Own)] == [
            "(value: 'int' = 0, other: 'str' = 'x') -> None",
            "(value: 'int' = 0, other: 'str' = 'x') -> None",
            "(word: 'str') -> 'None'",
        ]
        assert Own("abc") == Own("abc")
