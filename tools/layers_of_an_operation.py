"""What a swap passes from the API to SQL, and what a setting passes to the function of a part's program.

A real robot runs in virtual time with a real database; the swap is asked for as the API does it. A *layer* is a module
of MsBOT that waits on the stack: of the swap, in the event loop or in the writer's thread, when the UPDATE is executed;
of the setting, in the master when the slot's configuration is replaced, and in the part when the function is called.
What carries every message (links, sessions, the client) is not counted there. Run it:

    python tools/layers_of_an_operation.py
"""

from __future__ import annotations

import asyncio
import sys
import threading
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType

sys.path.insert(0, str(Path(__file__).parents[1]))

from sqlalchemy import event

from msbot.operations.rights import Role
from msbot.operations.table import OPERATIONS
from msbot.pnp import Configuration
from msbot.pnp.inventory_record import InventoryRecord
from msbot.pnp.state_changes import StateChanges
from msbot.registry.database.database_writer import PendingChange
from msbot_web.api.operation_routes import _call_of
from tests.operations.stage import AA_IS_A_DIAL, Stage, play
from tests.web.rig import Rig, show

SOURCES = tuple((Path(__file__).parents[1] / "packages").glob("*/src"))
MOST = 6
"""The goal for a swap."""
MOST_OF_A_SETTING = 5
"""The goal for a setting, at each end."""
CARRIERS = ("msbot_agent/link/", "msbot_xrce/", "msbot/part/client/")
"""What carries every message."""
TEST_LOOP = "msbot/process/virtual_time"


def module_of(file: str) -> str | None:
    """The module of MsBOT that a file holds; None: another's."""
    path = Path(file)
    name = next((str(path.relative_to(one).with_suffix("")) for one in SOURCES if path.is_relative_to(one)), None)
    return None if name == TEST_LOOP else name


def room_of(module: str) -> str:
    """The room of a module: `msbot/operations`."""
    return "/".join(module.split("/")[:2])


def modules_on(frame: FrameType | None) -> list[str]:
    """The modules of MsBOT on a stack, from the outermost inwards, each once."""
    found: list[str] = []
    while frame is not None:
        name = module_of(frame.f_code.co_filename)
        if name is not None and name not in found:
            found.append(name)
        frame = frame.f_back
    return found[::-1]


def is_writers(frame: FrameType) -> bool:
    """Whether a frame belongs to the thread that writes."""
    return threading.current_thread().name == "msbot registry writer" and frame.f_code.co_name != "_take"


def measure() -> tuple[list[str], set[str], int]:
    """The layers of a swap, the files it touches, and how often it changes room."""
    handed_over: list[str] = []
    layers: list[str] = []
    files: set[str] = set()
    rooms: list[str] = []
    made = PendingChange.__init__

    def noted(self: PendingChange[object], *args: object) -> None:
        handed_over[:] = modules_on(sys._getframe(1))
        made(self, *args)  # type: ignore[arg-type]

    def called(frame: FrameType, what: str, _argument: object) -> None:
        name = module_of(frame.f_code.co_filename) if what == "call" else None
        if name is None or not (is_writers(frame) or "msbot_web/api/operation_routes" in modules_on(frame)):
            return  # the robot goes on meanwhile
        files.add(name)
        room = room_of(name)
        if not rooms or rooms[-1] != room:
            rooms.append(room)

    async def scene(rig: Rig) -> None:
        rig.stage.plug("DD", "EFGH")
        await rig.look(2.0)
        await asyncio.to_thread(rig.stage.registry.storage.flush)
        swap = OPERATIONS["swap"]
        call = _call_of(swap, swap.call.split()[1], rig.service)
        teacher = rig.session(Role.TEACHER)

        @event.listens_for(rig.stage.registry.storage.engine, "before_cursor_execute")
        def execute(_connection: object, _cursor: object, statement: str, *_: object) -> None:
            if statement.startswith("UPDATE parts") and not layers:
                thread = modules_on(sys._getframe(1))
                layers.extend([*handed_over, *(name for name in thread if name not in handed_over)])

        body = type("Body", (), {"part": "DD"})()
        PendingChange.__init__ = noted  # type: ignore[method-assign, assignment]
        threading.setprofile(called)
        sys.setprofile(called)
        try:
            done = await call(session=teacher, slot="BB", body=body)
        finally:
            sys.setprofile(None)
            threading.setprofile(None)
            PendingChange.__init__ = made  # type: ignore[method-assign]
        assert "DD" in done.words, done
        assert rig.stage.slot("DD") == "BB"

    with TemporaryDirectory() as folder:
        show(Path(folder), scene)
    return layers, files, len(rooms) - 1


def measure_setting() -> tuple[list[str], list[str]]:
    """The layers of a setting in the master and in the part."""
    ends: dict[str, list[str]] = {}
    configure = StateChanges.configure

    def noted(self: StateChanges, record: InventoryRecord, configuration: Configuration) -> None:
        ends["master"] = modules_on(sys._getframe(1))
        configure(self, record, configuration)

    async def scene(stage: Stage) -> None:
        part = stage.plug("AA", "DIAL")

        @part.on_setting("period_s", float, default=1.0)
        def follow(value: float) -> None:
            if value == 0.75:
                ends["part"] = [one for one in modules_on(sys._getframe(1)) if not one.startswith(CARRIERS)]

        await asyncio.sleep(2.0)
        StateChanges.configure = noted  # type: ignore[method-assign]
        try:
            await stage.do.set("AA", "period_s", "0.75", who="ann")
        finally:
            StateChanges.configure = configure  # type: ignore[method-assign]
        await asyncio.sleep(2.0)

    with TemporaryDirectory() as folder:
        play(Path(folder), scene, AA_IS_A_DIAL)
    return ends["master"], ends["part"]


def main() -> None:
    """Print the figures; ends with status 1 when there are more layers than is the goal."""
    layers, files, changes = measure()
    assert files, "no file of MsBOT was seen"
    rooms = {room_of(file) for file in files}
    is_good = show_layers("a swap, from the API to SQL", layers, MOST)
    print(f"{len(files)} files of {len(rooms)} rooms; {changes} changes of room")
    master, part = measure_setting()
    is_good &= show_layers("a setting, in the master", master, MOST_OF_A_SETTING)
    is_good &= show_layers("a setting, in the part", part, MOST_OF_A_SETTING)
    sys.exit(not is_good)


def show_layers(what: str, layers: list[str], most: int) -> bool:
    """Print them; whether there are as few as is the goal."""
    print(f"{what}: {len(layers)} layers (at most {most})")
    for layer in layers:
        print(f"  {layer}")
    return 0 < len(layers) <= most


if __name__ == "__main__":
    main()
