"""Class lists: any file is a list of people or refused in a sentence that names it."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from msbot.operations.rights import Role
from msbot_web.access.class_list import new_accounts, new_password, read_people
from msbot_web.access.passwords import check_password
from msbot_xrce.errors import ConfigError


@given(st.binary(max_size=200))
def test_any_octets_are_people_or_refused_with_the_name_of_the_file(octets: bytes) -> None:
    try:
        found = read_people(octets, "class.csv")
    except ConfigError as error:
        words = str(error)
    else:
        words, names = "class.csv", [one.name for one in found]
        assert all(names)
        assert len(set(names)) == len(names)
    assert words.startswith("class.csv")


def test_who_has_no_role_and_no_password_gets_them() -> None:
    ada, bob = new_accounts(b"name,role\nada,teacher\nbob,\n", "class.csv", Role.STUDENT)
    assert (ada.name, ada.role, bob.name, bob.role) == ("ada", Role.TEACHER, "bob", Role.STUDENT)
    assert ada.password != bob.password


def test_made_up_passwords_will_do_and_differ() -> None:
    made = {new_password() for _ in range(200)}
    assert len(made) == 200
    for one in made:
        check_password(one)
