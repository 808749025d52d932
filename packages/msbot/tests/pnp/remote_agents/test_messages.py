"""Texts that go between a master and an agent elsewhere: whatever they are, they fit and can be read."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from msbot.pnp.remote_agents.agent_messages import MOST_TEXT, short


@given(st.text(max_size=30), st.integers(0, 2 * MOST_TEXT), st.sampled_from("aä€\U0001f916\ud800\0"))
def test_a_text_is_cut_where_it_is_too_long_and_nowhere_else(begin: str, times: int, letter: str) -> None:
    text = begin + letter * times
    plain = text.replace("\0", " ").encode(errors="replace").decode()
    told = short(text)
    assert len(told.encode()) <= MOST_TEXT
    assert "\0" not in told
    if len(plain.encode()) <= MOST_TEXT:
        assert told == plain
    else:
        assert told.endswith("…")
        assert plain.startswith(told[:-1])
        # Not a letter more would have fitted.
        assert len(told.encode()) + len(plain[len(told) - 1].encode()) > MOST_TEXT
