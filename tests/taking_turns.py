"""Which worker runs which file of tests: a file stays whole, and at each moment there is something of every kind.

There are three workers more than processors, because tests in browsers and of whole processes, machines and networks
wait for much of their time. A page that is open and a robot that runs cost a quarter of a processor, also while a test
waits. With a browser on each worker, half of a computer with two processors would go into that; so there are as many
browsers as processors. One worker always has what only computes, and two have when no browser is left, so that the
processors are never idle. Who has a browser keeps it as long as there are such files.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from xdist.scheduler import LoadFileScheduling

if TYPE_CHECKING:
    import pytest
    from xdist.remote import Producer
    from xdist.workermanage import WorkerController

BROWSERS = "packages/msbot-web/tests/web/browser/"
WAITING = (
    "tests/e2e/",
    "tests/hostile/",
    "packages/msbot-school/tests/lab/test_processes.py",
    "packages/msbot-agent/tests/space/",
    "packages/msbot-agent/tests/wide/",
    "tests/socketcan/",
    "packages/msbot-school/tests/school/test_mdns.py",
    "packages/msbot/tests/hardware/test_keeper.py",
    "packages/msbot/tests/registry/database/test_storage.py",
    "packages/msbot/tests/cli/change/test_robot_access.py",
    "packages/msbot/tests/cli/bus/",
    "packages/msbot-web/tests/web/api/test_routes.py",
)
"""Files that wait for more than half of their time."""
MORE_WORKERS = 3
"""As many more than there are processors."""


class TakingTurns(LoadFileScheduling):  # type: ignore[misc]  # xdist has no types
    """Hands out the files in their order, and passes over those of a kind of which enough workers have one."""

    def _assign_work_unit(self, node: WorkerController) -> None:
        others = [self._newest(other) for other in self.assigned_work if other is not node]
        browsers = sum(file.startswith(BROWSERS) for file in others)
        waiting = sum(file.startswith(WAITING) for file in others)
        may_browse = browsers < max(1, self.numnodes - MORE_WORKERS)
        may_wait = waiting < max(1, self.numnodes - 2) and browsers + waiting < max(1, self.numnodes - 1)

        def may(file: str) -> bool:
            return may_browse if file.startswith(BROWSERS) else may_wait or not file.startswith(WAITING)

        wanted = next(filter(may, self.workqueue), None)
        if wanted is not None:
            self.workqueue.move_to_end(wanted, last=False)
        super()._assign_work_unit(node)

    def _newest(self, node: WorkerController) -> str:
        """The file with a browser, or else one that waits, that it has not done yet; empty: neither."""
        left = []
        for number, (file, done) in enumerate(reversed(self.assigned_work[node].items())):
            if number and all(done.values()):
                break  # and so are all before it
            left.append(file)
        return min(left, key=lambda file: (not file.startswith(BROWSERS), not file.startswith(WAITING)), default="")


def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> TakingTurns | None:
    """Of `--dist loadfile`."""
    return TakingTurns(config, log) if config.getoption("dist") == "loadfile" else None
