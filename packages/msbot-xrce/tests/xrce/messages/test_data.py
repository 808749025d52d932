"""WRITE_DATA, DATA, READ_DATA."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.messages import Data, DeliveryControl, ReadData, Submessage, WriteData, iter_submessages

U16 = st.integers(0, 0xFFFF)
OCTET = st.integers(0, 0xFF)
TEXT = st.text(st.characters(exclude_characters="\0", codec="utf-8"), max_size=12)


def one(octets: bytes) -> Submessage:
    (submessage,) = iter_submessages(octets, 0)
    return submessage


@given(U16, U16, st.binary(max_size=300))
def test_samples_round_trip(request_id: int, object_id: int, payload: bytes) -> None:
    for sample in (WriteData(request_id, object_id, payload), Data(request_id, object_id, payload)):
        assert one(sample.encode()) == sample


@pytest.mark.parametrize("submessage_id", [0x07, 0x09])
def test_empty_sample_is_a_sample(submessage_id: int) -> None:
    sample = one(bytes.fromhex(f"{submessage_id:02x}010400 001e0015"))
    assert isinstance(sample, WriteData | Data)
    assert sample.payload == b""


@pytest.mark.parametrize("submessage_id", [0x07, 0x09])
@pytest.mark.parametrize(
    ("flags", "name"),
    [(0x03, "SAMPLE"), (0x09, "DATA_SEQ"), (0x0B, "SAMPLE_SEQ"), (0x0F, "PACKED_SAMPLES"), (0x05, "0x04")],
)
def test_other_formats_than_data_are_refused(submessage_id: int, flags: int, name: str) -> None:
    with pytest.raises(RemoteProtocolError, match=f"in format {name}: only DATA is spoken"):
        one(bytes.fromhex(f"{submessage_id:02x}{flags:02x}0800 001e0015 00000000"))


@pytest.mark.parametrize("length", [1, 2, 3])
def test_data_of_less_than_4_octets_is_refused(length: int) -> None:
    with pytest.raises(RemoteProtocolError, match="DATA: "):
        one(bytes.fromhex(f"0901{length:02x}00 000000"))


@pytest.mark.parametrize("make", [WriteData, Data])
@pytest.mark.parametrize(("size", "length"), [(65531, "ffff"), (65532, "0000"), (200_000, "0000")])
def test_samples_above_64_kib_have_length_0(make: type[WriteData | Data], size: int, length: str) -> None:
    sample = make(1, 2, bytes(size))
    assert sample.encode()[2:4].hex() == length
    assert one(sample.encode()) == sample


@given(
    st.builds(
        ReadData,
        U16,
        U16,
        OCTET,
        st.none() | st.builds(DeliveryControl, U16, U16, U16, U16),
        OCTET,
        st.none() | TEXT,
    )
)
def test_read_data_round_trip(read: ReadData) -> None:
    assert one(read.encode()) == read


@pytest.mark.parametrize(
    "octets",
    [
        "08010800 001d0016 80000200",
        "08010800 001d0016 80000002",
        "08010800 001d0016 80000001",
        "08010600 001d0016 8000",
    ],
)
def test_wrong_read_data_is_refused(octets: str) -> None:
    with pytest.raises(RemoteProtocolError, match="READ_DATA: "):
        one(bytes.fromhex(octets))
