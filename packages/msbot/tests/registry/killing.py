"""Run by `test_kill.py` in a process of its own: masters that are killed with SIGKILL at random moments.

Each child is forked from this process, which has everything imported, and is a whole robot in virtual time: master,
inventory, parts on a wire, and the operations that people use: swap, release, adopt, set, reset, bind, unbind, block,
undo. After each change that has returned, it tells so by a pipe. After its death the database is looked at.
"""

import asyncio
import json
import logging
import os
import signal
import sys
import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import partial
from itertools import count
from pathlib import Path
from random import Random

from sqlalchemy import Engine
from sqlalchemy import select as select_rows

from msbot.config import Blueprint, Library, load_blueprint, load_library, write_sample
from msbot.master import Master
from msbot.operations.dispatch import InProcessOperations
from msbot.process.virtual_time import run_virtual
from msbot.registry import open_registry, registry
from msbot.registry.database.engine import Address, make_engine
from msbot.registry.database.tables import edits
from msbot.registry.edits.undo import read_cell
from msbot.registry.maintenance import database_maintenance
from msbot_agent.link import InprocHub, LinkInfo
from msbot_xrce.errors import MsbotError
from tests.operations.stage import AA_IS_A_DIAL, DIAL, Deeds, Stage

MOST_EDITS = 3
LONGER_S = 0.01
"""A child is killed after a random number of edits and then a random time: in the middle of something."""
PARTS = {"one": "DIAL", "two": "DIAL"}
"""Local name -> part number; there is one slot for the two."""
TOPIC = "HelloWorldTopic_1_to_2"


def robot_in(folder: Path) -> tuple[Blueprint, Library]:
    """The sample robot with a part type that has a parameter."""
    write_sample(folder / "robot.toml")
    text = (folder / "robot.toml").read_text()
    (folder / "robot.toml").write_text(text.replace(*AA_IS_A_DIAL))
    (folder / "DIAL.toml").write_text(DIAL)
    library = load_library(folder / "DIAL.toml")
    return load_blueprint(folder / "robot.toml", library), library


async def change(do: Deeds, dice: Random) -> int | None:
    """Do one thing; gives the number of the edit."""
    deeds = (
        lambda: do.set("AA", "period_s", f"{dice.randint(1, 90) / 10}", who="Ann"),
        lambda: do.reset("AA", "period_s", who="Ann"),
        lambda: do.swap("AA", dice.choice(("one", "two")), who="Ann"),
        lambda: do.swap("AA", dice.choice(("one", "two")), who="Ann"),
        lambda: do.unbind(TOPIC, "BB.in", who="Ann"),
        lambda: do.bind(TOPIC, "HelloWorld", "AA.out", ["BB.in"], who="Ann"),
        lambda: do.block("ABCD", "why not", who="Ann"),
        lambda: do.unblock("ABCD", who="Ann"),
        lambda: do.undo(who="Ann"),
    )
    return (await dice.choice(deeds)()).edit_id


ENGINES: dict[str, Engine] = {}


def same_engine(address: Address, *, busy_timeout_s: float, read_only: bool) -> Engine:
    """One engine for each database, whose compiled statements every child inherits: half of its start otherwise."""
    if address.words not in ENGINES:
        ENGINES[address.words] = make_engine(address, busy_timeout_s=busy_timeout_s, read_only=False)
    return ENGINES[address.words]


def live(
    folder: Path, blueprint: Blueprint, library: Library, seed: int, told: int, deeds: Iterable[object] = count()
) -> None:
    """One child: change the robot until somebody kills us, or all deeds are done."""
    logging.disable()  # that a port is not bound is known
    dice = Random(seed)

    async def main() -> None:
        with open_registry(folder / "robot.db") as database:
            known = database.robots.find(blueprint)
            # Applying the blueprint takes half of the start; once in a while is enough.
            robot = (
                database.robots.apply_blueprint(blueprint, library) if known is None or dice.random() < 0.2 else known
            )
            master = Master(blueprint, database.runs.begin(robot), random=dice, epoch_ns=time.time_ns)
            hub = InprocHub()
            hub.server.info = LinkInfo("wire", 65535)
            master.add_link(hub.server)
            stage = Stage(master, InProcessOperations(master, database, robot, library=library), database, hub)
            async with asyncio.TaskGroup() as tasks:
                stage.tasks = tasks
                running = tasks.create_task(master.run())
                await master.ready.wait()
                for name, number in PARTS.items():
                    stage.plug(name, number)
                await asyncio.sleep(1.0)
                os.write(told, b"ready\n")
                for _ in deeds:
                    with suppress(MsbotError):
                        os.write(told, f"{await change(stage.do, dice) or 0}\n".encode())
                    await asyncio.sleep(0.05)
                stage.pull_all()
                running.cancel()

    run_virtual(main())


def one_life(folder: Path, blueprint: Blueprint, library: Library, dice: Random) -> int:
    """Fork a child, kill it at a random moment, and give the number of the last edit it has told of."""
    seed, edits_first, longer_s = dice.getrandbits(32), dice.randint(0, MOST_EDITS), dice.uniform(0, LONGER_S)
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        try:
            live(folder, blueprint, library, seed, writing)
        finally:
            os._exit(3)
    os.close(writing)
    with os.fdopen(reading) as stream:
        assert stream.readline() == "ready\n", "the child ended before it was ready"
        lines = [stream.readline() for _ in range(edits_first)]
        time.sleep(longer_s)
        os.kill(child, signal.SIGKILL)
        lines += [line for line in stream.read().splitlines(keepends=True) if line.endswith("\n")]
    _, status = os.waitpid(child, 0)
    assert os.WIFSIGNALED(status), "the child ended by itself"
    return max(map(int, lines), default=0)


def faults_of(folder: Path, told: int, before: int) -> tuple[list[str], int]:
    """What is wrong in the database of a dead master, and the number of its newest edit."""
    path = folder / "robot.db"
    faults = database_maintenance.check(str(path))
    with open_registry(path, read_only=True) as database:
        (robot,) = database.robots.all()
        if [value.name for value in database.robots.values(robot, "AA")] != ["period_s"]:
            faults.append("slot AA has lost its settings")
        rows = database.storage.read(
            lambda connection: connection.execute(select_rows(edits).order_by(edits.c.id)).all()
        )
        numbers = [row.id for row in rows]
        if len(numbers) < max(told, before):
            faults.append(f"edit {max(told, before)} was told and is not there; the newest is {len(numbers)}")
        if numbers != list(range(1, len(numbers) + 1)):
            faults.append("the numbers of the edits have a gap")
        held = {json.dumps([_key(row.after, name) for name in KEYS]): row for row in rows if row.after}
        for row in held.values():
            present = database.storage.read(partial(read_cell(row.after).as_it_is, robot_id=robot.id)).as_json()
            if _of_people(present) != _of_people(row.after):
                faults.append(f"edit {row.id} left {row.after}, and it is {present}")
    return faults, len(numbers)


KEYS = ("of", "slot", "name", "topic", "key", "parts")
"""What says which thing an edit is about; the newest edit of a thing must say how that thing is."""


def _key(cells: Mapping[str, object], name: str) -> object:
    value = cells.get(name)
    return sorted(value) if isinstance(value, dict) else value


def _of_people(cells: Mapping[str, object]) -> Mapping[str, object]:
    """Without what the inventory changes as well: the slot that a part was in last."""
    parts = cells.get("parts")
    return {**cells, "parts": [place[1] for place in parts.values()]} if isinstance(parts, dict) else cells


def main() -> None:
    """Arguments: folder, seed, lives. Prints a JSON object: kills, edits, faults."""
    folder, seed, lives = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    blueprint, library = robot_in(folder)
    dice = Random(seed)
    for module in (registry, database_maintenance):
        setattr(module, "make_engine", same_engine)  # noqa: B010 - it is no export
    with open(os.devnull, "wb") as nobody:
        live(folder, blueprint, library, seed, nobody.fileno(), range(60))
    _, newest = faults_of(folder, 0, 0)
    faults: list[str] = []
    for life in range(lives):
        told = one_life(folder, blueprint, library, dice)
        found, newest = faults_of(folder, told, newest)
        faults += [f"life {life}: {fault}" for fault in found]
    print(json.dumps({"kills": lives, "edits": newest, "faults": faults}))


if __name__ == "__main__":
    main()
