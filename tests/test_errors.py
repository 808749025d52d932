"""Every error is also the built-in error that a Python programmer would catch."""

from __future__ import annotations

import pytest

from msbot_xrce import errors

BUILT_IN = {
    errors.ConfigError: ValueError,
    errors.LinkError: ConnectionError,
    errors.LinkDown: ConnectionError,
    errors.LinkFull: ConnectionError,
    errors.LocalProtocolError: RuntimeError,
    errors.RemoteProtocolError: ValueError,
    errors.RequestTimeout: TimeoutError,
}


@pytest.mark.parametrize(("ours", "built_in"), BUILT_IN.items())
def test_an_error_is_also_the_built_in_one(ours: type[errors.MsbotError], built_in: type[Exception]) -> None:
    assert issubclass(ours, built_in)
    assert str(ours("what is wrong")) == "what is wrong"


def test_no_error_is_missing_from_the_table_in_the_docstring() -> None:
    ours = {kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, errors.MsbotError)}
    assert all(kind.__name__ in str(errors.__doc__) for kind in ours)


def test_a_timeout_carries_no_status() -> None:
    assert errors.RequestTimeout("no answer within 2 s").status is None
