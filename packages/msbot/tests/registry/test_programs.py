"""Programs of people: kept with their versions, shared by a word, gone with their owner."""

from __future__ import annotations

from functools import partial

import pytest

from msbot.registry import ProgramSource, Registry
from msbot.registry.edits import users
from msbot.registry.programs import MOST_PROGRAMS, MOST_VERSIONS
from msbot_xrce.errors import ConfigError, NotThere


def test_a_program_is_kept_with_its_versions(registry: Registry) -> None:
    kept = registry.programs
    assert kept.of("ann") == []
    assert [kept.store("ann", "one.py", ProgramSource(text)) for text in ("a", "b", "b", "a")] == [1, 2, 2, 3]
    assert kept.source("ann", "one.py") == ProgramSource("a")
    assert kept.source("ann", "one.py", 2) == ProgramSource("b")
    assert [(one.number, one.size) for one in kept.versions("ann", "one.py")] == [(3, 1), (2, 1), (1, 1)]
    made = ProgramSource("a", '{"msbot": 1}')
    assert [kept.store("ann", "one.py", source) for source in (made, made)] == [4, 4], "the blocks have changed"
    assert kept.source("ann", "one.py") == made
    kept.store("ann", "two.py", ProgramSource(""))
    kept.store("bob", "one.py", ProgramSource("bob's"))
    assert {program.name for program in kept.of("ann")} == {"one.py", "two.py"}
    kept.remove("ann", "one.py")
    assert [program.name for program in kept.of("ann")] == ["two.py"]
    assert kept.source("bob", "one.py") == ProgramSource("bob's")


def test_the_newest_versions_stay(registry: Registry) -> None:
    for number in range(MOST_VERSIONS + 5):
        registry.programs.store("ann", "one.py", ProgramSource(str(number)))
    numbers = [one.number for one in registry.programs.versions("ann", "one.py")]
    assert numbers == list(range(MOST_VERSIONS + 5, 5, -1))
    with pytest.raises(NotThere, match=r"version 5 of one.py is not kept any more"):
        registry.programs.source("ann", "one.py", 5)


def test_a_shared_program_is_read_by_its_word_and_nothing_else_is(registry: Registry) -> None:
    kept = registry.programs
    kept.store("ann", "one.py", ProgramSource("print(1)"))
    kept.store("ann", "two.py", ProgramSource("secret"))
    word = kept.share("ann", "one.py")
    assert kept.share("ann", "one.py") == word
    assert kept.shared(word) == ("ann", "one.py", ProgramSource("print(1)"))
    for wrong in ("", word[:-1], "two.py"):
        with pytest.raises(NotThere, match="nobody shares a program by that link"):
            kept.shared(wrong)


def test_nobody_has_programs_without_end_and_they_go_with_their_owner(registry: Registry) -> None:
    registry.edits.make(None, "setup", partial(users.keep, people=[users.Person("ann", "student", "salt")]))
    for number in range(MOST_PROGRAMS):
        registry.programs.store("ann", f"p{number}.py", ProgramSource(""))
    with pytest.raises(ConfigError, match="ann has 100 programs already: remove one first"):
        registry.programs.store("ann", "more.py", ProgramSource(""))
    registry.programs.store("bob", "one.py", ProgramSource(""))
    registry.edits.make(None, "setup", partial(users.remove, name="ann"))
    assert registry.programs.of("ann") == []
    assert len(registry.programs.of("bob")) == 1
    for deed in (
        registry.programs.remove,
        registry.programs.share,
        registry.programs.source,
        registry.programs.versions,
    ):
        with pytest.raises(NotThere, match=r"ann has no program 'p1.py'"):
            deed("ann", "p1.py")


def test_what_was_changed_last_comes_first_and_nothing_of_a_removed_program_is_left(registry: Registry) -> None:
    kept = registry.programs
    for name in ("one.py", "two.py", "one.py"):
        kept.store("ann", name, ProgramSource(f"{name} {len(kept.of('ann'))}"))
    word = kept.share("ann", "two.py")
    (first, second) = kept.of("ann")
    assert (first.name, first.share, second.name, second.share) == ("one.py", "", "two.py", word)
    (newest, oldest) = kept.versions("ann", "one.py")
    assert (newest.saved_ns, oldest.saved_ns < second.changed_ns) == (first.changed_ns, True)
    kept.store("ann", "two.py", kept.source("ann", "two.py"))
    assert [one.name for one in kept.of("ann")] == ["one.py", "two.py"], "it is unchanged"
    for name in ("one.py", "two.py"):
        kept.remove("ann", name)
        assert kept.store("ann", name, ProgramSource("anew")) == 1, "the database gives the same id again"
    with pytest.raises(NotThere):
        kept.shared(word)
