"""Which worker runs which file of tests: a file stays whole, and one worker at least has no browser.

A page that is open and a robot that runs cost a quarter of a processor, also while a test waits. With a browser on each
of three workers, a third of a computer with two processors would go into that; so meanwhile one of them does what needs
none. Who has a browser keeps it as long as there are such files.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from xdist.scheduler import LoadFileScheduling

if TYPE_CHECKING:
    import pytest
    from xdist.remote import Producer
    from xdist.workermanage import WorkerController

BROWSERS = "tests/web/browser/"


class TakingTurns(LoadFileScheduling):  # type: ignore[misc]  # xdist has no types
    """Hands out the files in their order, and passes over those with browsers while enough workers have one."""

    def _assign_work_unit(self, node: WorkerController) -> None:
        others = sum(other is not node and self._has_browser(other) for other in self.assigned_work)
        may = others < max(1, self.numnodes - 1)
        wanted = next((file for file in self.workqueue if may or not file.startswith(BROWSERS)), None)
        if wanted is not None:
            self.workqueue.move_to_end(wanted, last=False)
        super()._assign_work_unit(node)

    def _has_browser(self, node: WorkerController) -> bool:
        """Whether its newest file, or one that it has not done yet, has browsers."""
        for number, (file, done) in enumerate(reversed(self.assigned_work[node].items())):
            if number and all(done.values()):
                return False  # and so are all before it
            if file.startswith(BROWSERS):
                return True
        return False


def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> TakingTurns | None:
    """Of `--dist loadfile`."""
    return TakingTurns(config, log) if config.getoption("dist") == "loadfile" else None
