"""The quick checks of a bus: `msbot bus selftest`."""

from __future__ import annotations

from collections.abc import Callable

from msbot.link.can import CheckResult, selftest
from msbot.link.can.sim import SimBus, SimBusDriver
from msbot.runtime.virtual_time import run_virtual


def run_selftest(bitrate: int, frames: int, say: Callable[[str], None]) -> bool:
    """Make all checks on a simulated bus in virtual time; whether all went well."""

    async def main() -> tuple[list[CheckResult], SimBus]:
        driver = SimBusDriver(SimBus(bitrate))
        return await selftest(driver.attach("A"), driver.attach("B"), frames=frames), driver.bus

    results, bus = run_virtual(main())
    for result in results:
        say(f"{'passed' if result.passed else 'FAILED'}  {result.name}: {result.words}")
    counters = bus.counters
    say(
        f"{counters.frames} frames in {counters.busy_s:.3f} s of bus time at {bitrate // 1000} kbit/s, no hardware used"
    )
    return all(result.passed for result in results)
