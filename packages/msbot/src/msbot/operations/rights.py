"""Who may do what: four roles, each with all rights of the one below (thesis 5.4.2: only authorised people)."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum, IntEnum
from typing import NamedTuple

from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError


class Role(IntEnum):
    """The role of a person; a higher role may do everything that a lower one may."""

    VIEWER = 1
    STUDENT = 2
    TEACHER = 3
    ADMINISTRATOR = 4

    @property
    def word(self) -> str:
        """The role as it is stored and shown: `viewer`, `student`, `teacher`, `administrator`."""
        return self.name.lower()

    @property
    def with_article(self) -> str:
        """The same in a sentence: `a teacher`, `an administrator`."""
        return said(f"{'an' if self.word[0] in 'aeiou' else 'a'} {self.word}")


def role_named(word: str) -> Role:
    """The role of that name.

    Raises:
        ConfigError: there is no such role; the text lists them.
    """
    for role in Role:
        if role.word == word:
            return role
    raise ConfigError(
        said("there is no role {word!r}: choose {roles}", word=word, roles=", ".join(role.word for role in Role))
    )


class Right(Enum):
    """One kind of thing a person may do."""

    SEE = "see the robot"
    STOP = "press STOP"
    """Anybody who sees a robot run wild must be able to stop it."""
    STOP_CLASS = "stop all robots of the class"
    """At one press; whoever may press STOP may stop each of them on its own page."""
    JOIN = "run parts of one's own"
    """By the page; guests with a ticket may, too (`msbot_web.access.guest_tickets`)."""
    OPERATE = "play with simulated parts"
    """Also make a part identify itself."""
    SET = "change settings"
    """Parameters of slots, by hand."""
    ARRANGE = "arrange parts"
    """Adopt, swap, release and block them; undo; go on after STOP."""
    DESIGN = "change the blueprint"
    ADMINISTER = "administer users, keys and backups"

    @property
    def least(self) -> Role:
        """The lowest role that has this right."""
        return _LEAST[self]


_LEAST = {
    Right.SEE: Role.VIEWER,
    Right.STOP: Role.VIEWER,
    Right.STOP_CLASS: Role.TEACHER,
    Right.JOIN: Role.STUDENT,
    Right.OPERATE: Role.STUDENT,
    Right.SET: Role.STUDENT,
    Right.ARRANGE: Role.TEACHER,
    Right.DESIGN: Role.TEACHER,
    Right.ADMINISTER: Role.ADMINISTRATOR,
}


class Principal(NamedTuple):
    """Who asks for an operation, and what they may do."""

    name: str
    """For the journal."""
    require: Callable[[Right], None]
    """Raises when the person does not have that right at this moment."""
    may: Callable[[Right], bool]
    """Whether the person has that right."""
    place: str = ""
    """From where, in words, for whoever asks who said STOP; empty: not known."""
    since_ns: int = 0
    """When the person's account was made, on the wall clock: what somebody of that name did before is not theirs."""


def user_of_computer(name: str) -> Principal:
    """Whoever uses the computer that the robot's master runs on: may do everything."""
    return Principal(name, lambda _right: None, lambda _right: True)
