"""What is made at the start and stays."""

import gc

import pytest

from msbot_agent.startup.bytecode_cache import without_garbage_collection
from msbot_xrce.errors import ConfigError


def test_while_the_page_is_made_no_garbage_is_looked_for_and_afterwards_it_is() -> None:
    def fail() -> None:
        with without_garbage_collection():
            assert not gc.isenabled()
            raise ConfigError("the port is in use")

    try:
        with pytest.raises(ConfigError):
            fail()
        assert gc.isenabled()
        assert gc.get_freeze_count() > 0
    finally:
        gc.unfreeze()
