"""What a part says of its hardware before it ends: pieces in order, and nothing else, become a sentence."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.part.join.hardware_trouble import TROUBLE_OCTETS, TROUBLE_PIECES, TroublePiece, trouble_pieces
from msbot.part.join.pnp_messages import decode_request
from msbot.pnp.inventory_record import InventoryRecord
from msbot.pnp.model import LifeTiming


def record() -> InventoryRecord:
    return InventoryRecord(1, "here", LifeTiming(), 0.0)


def test_a_sentence_travels_in_pieces() -> None:
    sentence = "no BMP280 answers at 0x76 on I2C bus 1: check its supply, the wires SDA and SCL, and its address"
    pieces = [piece.encode() for piece in trouble_pieces(7, sentence)]
    assert {len(piece) for piece in pieces} == {17}
    heard = record()
    for octets in pieces:
        piece = decode_request(octets)
        assert isinstance(piece, TroublePiece)
        assert piece.lease == 7
        assert heard.trouble == ""
        heard.take_piece(piece.place, piece.text)
    assert heard.trouble == sentence


@given(st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=300))
def test_any_text_is_cut_and_cleaned(text: str) -> None:
    pieces = trouble_pieces(1, text)
    assert len(pieces) <= TROUBLE_PIECES
    heard = record()
    for piece in pieces:
        heard.take_piece(piece.place, piece.text)
    assert heard.trouble.isprintable()
    if len(text.encode()) <= TROUBLE_PIECES * TROUBLE_OCTETS:
        assert heard.trouble == "".join(letter for letter in text if letter.isprintable())


@pytest.mark.parametrize("lost", [0, 1])
def test_with_a_piece_missing_nothing_is_told(lost: int) -> None:
    pieces = trouble_pieces(1, "a sentence of three pieces, or so")
    assert len(pieces) == 3
    heard = record()
    for place, piece in enumerate(pieces):
        if place != lost:
            heard.take_piece(piece.place, piece.text)
    assert heard.trouble == "" or lost == 0
    assert "sentence of three" not in heard.trouble


@given(st.lists(st.tuples(st.integers(0, 255), st.binary(min_size=12, max_size=12)), max_size=40))
def test_whatever_a_part_says_is_bounded(said: list[tuple[int, bytes]]) -> None:
    heard = record()
    for place, text in said:
        heard.take_piece(place, text)
    assert len(heard.trouble_pieces) <= TROUBLE_PIECES * TROUBLE_OCTETS
    assert heard.trouble.isprintable()
