"""Which browsers a person is known in."""

from __future__ import annotations

from msbot_web.access.accounts import MOST_KNOWN, MOST_OF_ONE, KnownBrowsers


def test_each_browser_has_a_word_of_its_own_which_is_kept_while_its_person_uses_it() -> None:
    known = KnownBrowsers()
    first, second = known.note_sign_in("", "ada"), known.note_sign_in("", "ada")
    assert first != second
    assert known.find(first, "ada") != known.find(second, "ada")
    assert known.note_sign_in(first, "ada") == first


def test_a_word_is_worth_nothing_for_another_person_and_a_made_up_one_is_not_taken() -> None:
    known = KnownBrowsers()
    word = known.note_sign_in("", "ada")
    assert not known.find(word, "bob")
    assert known.note_sign_in(word, "bob") != word
    assert known.find(word, "ada"), "both have signed in there"
    assert known.note_sign_in("made up", "bob") != "made up"
    for odd in ("", "\ud800", "\xe4", "x" * 100_000):
        assert not known.find(odd, "ada")


def test_it_ends_by_itself_and_with_the_person() -> None:
    known = KnownBrowsers()
    first, second, other = known.note_sign_in("", "ada"), known.note_sign_in("", "ada"), known.note_sign_in("", "bob")
    known.end(first)
    known.end("")
    assert not known.find(first, "ada")
    assert known.find(second, "ada")
    known.end_all_of("ada")
    assert not known.find(second, "ada")
    assert known.find(other, "bob")


def test_of_too_many_the_longest_unused_of_the_same_person_goes_first() -> None:
    known = KnownBrowsers()
    bob = known.note_sign_in("", "bob")
    words = [known.note_sign_in("", "ada") for _ in range(MOST_OF_ONE)]
    known.note_sign_in(words[0], "ada")
    known.note_sign_in("", "ada")
    assert [bool(known.find(word, "ada")) for word in words[:3]] == [True, False, True]
    assert known.find(bob, "bob")
    for number in range(MOST_KNOWN):
        known.note_sign_in("", f"pupil {number}")
    assert len(known.to_persist()) == MOST_KNOWN


def test_what_is_kept_is_known_again_and_signs_nobody_in() -> None:
    known, after = KnownBrowsers(), KnownBrowsers()
    word = known.note_sign_in("", "ada")
    after.bring_back(known.to_persist())
    assert after.find(word, "ada")
    assert word not in str(known.to_persist())
