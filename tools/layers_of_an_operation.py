"""What a swap passes on its way from the API to SQL: the layers, the files, and the changes of room.

A real robot runs in virtual time with a real database; the swap is asked for as the API does it. A *layer* is a module
of MsBOT that waits on the stack, in the event loop or in the writer's thread, when the UPDATE is executed. Run it:

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

import msbot
from msbot.operations.rights import Role
from msbot.operations.table import OPERATIONS
from msbot.registry.database.writer import PendingChange
from msbot_web.api.operation_routes import _call_of
from tests.web.rig import Rig, show

ROOT = Path(msbot.__file__).parent
MOST = 6
"""The goal."""


def module_of(file: str) -> str | None:
    """The module of MsBOT that a file holds; None: another's."""
    path = Path(file)
    return str(path.relative_to(ROOT).with_suffix("")) if path.is_relative_to(ROOT) else None


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
        if name is None or not (is_writers(frame) or "web/api/operation_routes" in modules_on(frame)):
            return  # the robot goes on meanwhile
        files.add(name)
        room = name.partition("/")[0]
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
                thread = [name for name in modules_on(sys._getframe(1)) if not name.startswith("runtime/")]
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
    ours = [name for name in layers if not name.startswith("runtime/")]
    return ours, files, len(rooms) - 1


def main() -> None:
    """Print the figures; ends with status 1 when there are more layers than is the goal."""
    layers, files, changes = measure()
    print(f"{len(layers)} layers (at most {MOST}):")
    for layer in layers:
        print(f"  {layer}")
    print(f"{len(files)} files of {len({file.partition('/')[0] for file in files})} rooms; {changes} changes of room")
    sys.exit(len(layers) > MOST)


if __name__ == "__main__":
    main()
