"""The quick checks of a bus: `msbot bus selftest`."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict

from msbot.process.virtual_time import run_virtual
from msbot_agent.link.can import CheckResult, selftest
from msbot_agent.link.can.sim import SimBus, SimBusDriver


def run_selftest(bitrate: int, frames: int, say: Callable[[str], None], *, as_json: bool = False) -> bool:
    """Make all checks on a simulated bus in virtual time; returns whether all passed."""

    async def main() -> tuple[list[CheckResult], SimBus]:
        driver = SimBusDriver(SimBus(bitrate))
        return await selftest(driver.attach("A"), driver.attach("B"), frames=frames), driver.bus

    results, bus = run_virtual(main())
    counters, passed = bus.counters, all(result.passed for result in results)
    if as_json:
        checks = [asdict(result) for result in results]
        figures = {"bitrate": bitrate, "frames": counters.frames, "busy_s": counters.busy_s}
        say(json.dumps({"passed": passed, "checks": checks, **figures}))
        return passed
    for result in results:
        say(f"{'passed' if result.passed else 'FAILED'}  {result.name}: {result.words}")
    say(
        f"{counters.frames} frames in {counters.busy_s:.3f} s of bus time at {bitrate // 1000} kbit/s, no hardware used"
    )
    return passed
