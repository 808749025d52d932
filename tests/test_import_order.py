"""Workers import all test modules, each from its own place on."""

from __future__ import annotations

from pathlib import Path

from tests import ROOT
from tests.import_order import begun_at, modules_in

HERE = Path(__file__).parent


def test_each_worker_imports_all_of_them_and_begins_where_no_other_does() -> None:
    modules = [f"m{number}" for number in range(7)]
    orders = [begun_at(worker, 3, modules) for worker in range(3)]
    assert [order[0] for order in orders] == ["m0", "m2", "m4"]
    assert all(sorted(order) == modules for order in orders)
    assert begun_at(1, 3, []) == []


def test_a_module_has_the_name_by_which_pytest_imports_it() -> None:
    assert __name__ in modules_in(Path(__file__)) == modules_in(HERE / "test_import_order.py")
    there = modules_in(HERE)
    assert __name__ in there
    assert "tests.e2e.processes" not in there
    assert "tests.link.net.test_udp" in modules_in(ROOT / "packages/msbot-agent/tests/link")
    assert modules_in(HERE.parent / "README.md") == modules_in(HERE.parent / "tools" / "set_up.py") == []
