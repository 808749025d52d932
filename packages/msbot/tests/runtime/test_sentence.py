"""Sentences that can be said in another language: they are texts, and they survive errors, pickles and databases."""

from __future__ import annotations

import json
import pickle
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_agent.text.sentence import Sentence, counted, from_json, said, to_json, without
from msbot_xrce.errors import ConfigError

BY_HAND = said(
    "{part} is {state}: {reason}",
    part="AA",
    state=said("lost"),
    reason=said("no beat for {seconds:.1f} s", seconds=5.04),
)


def test_a_sentence_is_a_text() -> None:
    assert BY_HAND == "AA is lost: no beat for 5.0 s"
    assert json.dumps({BY_HAND: BY_HAND}) == json.dumps({str(BY_HAND): "AA is lost: no beat for 5.0 s"})
    assert counted(1, "{count} part", "{count} parts") == "1 part"
    assert counted(2, "{count} part", "{count} parts") == "2 parts"


def test_braces_of_a_text_without_values_stay() -> None:
    assert said("a part called {x}") == "a part called {x}"


def test_an_error_keeps_its_sentence() -> None:
    words: Any = str(ConfigError(BY_HAND))
    assert words.form == BY_HAND.form


def test_another_process_gets_the_whole_sentence() -> None:
    there = pickle.loads(pickle.dumps(BY_HAND))
    assert (there, there.form, there.values) == (BY_HAND, BY_HAND.form, BY_HAND.values)


def test_a_database_gives_it_back() -> None:
    there: Any = from_json(json.loads(json.dumps(to_json(BY_HAND))))
    assert (there, there.form) == (BY_HAND, BY_HAND.form)
    assert there.values["reason"].values == {"seconds": 5.04}


values = st.one_of(st.text(), st.integers(), st.floats(allow_nan=False), st.booleans(), st.none())


@given(st.dictionaries(st.sampled_from(["a", "b", "c"]), values))
def test_whatever_its_values_are_it_reads_the_same_afterwards(given_values: dict[str, object]) -> None:
    sentence = Sentence(" ".join(f"{{{name}}}" for name in given_values), given_values)
    assert from_json(json.loads(json.dumps(to_json(sentence)))) == sentence


@pytest.mark.parametrize(
    "content",
    [
        None,
        7,
        [],
        {},
        {"form": 1, "values": {}},
        {"form": "{x}", "values": {}},
        {"form": "{x.y}", "values": {"x": 1}},
        {"form": "{", "values": {"x": 1}},
        {"form": "{0}", "values": {"x": 1}},
        {"form": "{x:d}", "values": {"x": "y"}},
    ],
)
def test_what_makes_no_sense_is_shown_as_it_stands(content: object) -> None:
    assert isinstance(from_json(content), str)


def test_values_of_a_name_can_be_left_out_wherever_they_stand() -> None:
    text = said(
        "{who}: {why}",
        who=said("{address}", address="here"),
        why=said("seen at {address}, {n:.1f} s", address="there", n=2),
    )
    assert without(text, {"address"}, "…") == "…: seen at …, 2.0 s"
    assert without("here", {"address"}, "…") == "here"
    assert text == "here: seen at there, 2.0 s"
