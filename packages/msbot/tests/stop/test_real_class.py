"""Nothing is heard after all have confirmed STOP of a class: by its page, and while all get one blueprint."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator

import pytest

from tests.stop.real_class import RealClass, by_class_page, real_class, rolled_out, under_way
from tests.web.browser.conftest import NEEDED, chromium

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="`msbot stop` has its socket on Linux")
PROMISE = "After all parts have confirmed STOP, nothing reaches a part's function, by whatever way it was said"


@pytest.fixture(scope="module")
def robots(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RealClass]:
    with real_class(tmp_path_factory.mktemp("class")) as made:
        yield made


@pytest.mark.promise("Nothing is heard after all parts have confirmed STOP, whatever they are and whatever happens")
def test_nothing_is_heard_during_a_roll_out_and_its_undo(robots: RealClass) -> None:
    for deed in (rolled_out, under_way):
        verdict = deed(robots)
        assert verdict.is_right, (deed.__name__, verdict)


@pytest.mark.promise(PROMISE)
def test_nothing_is_heard_after_the_class_page_has_said_it(robots: RealClass) -> None:
    found = chromium()
    if found is None:
        (pytest.fail if os.environ.get(NEEDED) else pytest.skip)(
            "no Chromium on this machine: apt-get install chromium"
        )
    verdict = by_class_page(robots, found)
    assert verdict.is_right, verdict
