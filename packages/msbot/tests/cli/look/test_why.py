"""What `msbot why` prints for every reason to turn a part away, and for what else happens to it (R80)."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from pathlib import Path
from random import Random

import pytest
from click.testing import CliRunner
from hypothesis import example, given
from hypothesis import strategies as st

from msbot.cli.database_commands import why_command
from msbot.config import load_blueprint, load_library, write_sample
from msbot.part.join import pnp_messages, thesis_messages
from msbot.part.join.part_keys import prove
from msbot.pnp import Claim, Inventory, Refusal
from msbot.pnp.key_proof import UNANSWERED_S, Keys
from msbot.pnp.requests import RequestHandler
from msbot.registry import Registry, RobotRecord, RobotStore, open_registry
from msbot_agent.cli.table import folded
from msbot_xrce.errors import ConfigError, RegistryError
from tests.operations.stage import Stage, play, put_database
from tests.registry.hand import Hand

RING = ("ABCD", "EFGH", "WXYZ")
EFGH, KEY = b"EFGH-one", bytes(range(16))


@pytest.fixture(autouse=True)
def _nobody_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))


@example(["a" * 37], 40)
@given(st.lists(st.text("abc-/.é", min_size=1, max_size=60), min_size=1, max_size=30), st.integers(40, 120))
def test_a_long_sentence_goes_on_between_two_words(words: list[str], columns: int) -> None:
    lines = folded("  - " + " ".join(words), columns).split("\n")
    assert " ".join(lines).split() == ["-", *words]
    assert all(len(line) <= columns or len(line.split()) <= 2 for line in lines)
    assert lines[0].startswith("  - ")
    assert all(line.startswith(" " * 6) for line in lines[1:])


class Counter:
    """A handler of requests and an inventory on a real database, with a clock turned by hand."""

    def __init__(self, registry: Registry, robot: RobotRecord) -> None:
        self.registry, self.robot, self.now = registry, robot, 100.0
        self.store: RobotStore = registry.runs.begin(robot)
        self.inventory = Inventory(self.store, random=Random(1), now=self.now)
        self.requests = RequestHandler(self.inventory, keys=Keys(self.store, Random(2)))
        self._sessions = 0

    def claim(self, number: str, *, uid: bytes = EFGH, name: str = "DD") -> int:
        """Claim through a session of its own; gives its key."""
        self._sessions += 1
        self.inventory.client_joined(self._sessions, f"peer {self._sessions}", self.now)
        self.again(number, self._sessions, uid=uid, name=name)
        return self._sessions

    def again(self, number: str, key: int, *, uid: bytes = EFGH, name: str = "DD") -> None:
        self.inventory.claim(Claim(number, name, uid), key, self.now)

    def ask(self, *, uid: bytes = EFGH, key: int = 77, asker: bytes = bytes(16)) -> bytes:
        """Claim in a robot with keys; gives the nonce, if any."""
        self.inventory.client_joined(key, f"peer {key}", self.now)
        claim = pnp_messages.ClaimMessage(part_number="EFGH", local_name="DD", uid=uid, session_nonce=1)
        answer = self.requests.compact(claim.encode(), key, self.now, asker)
        return b"" if answer is None else pnp_messages.Challenge.decode(answer).nonce

    def show(self, proof: bytes, *, key: int = 77, asker: bytes = bytes(16)) -> None:
        self.requests.compact(pnp_messages.Proof(proof=proof).encode(), key, self.now, asker)


def why(folder: Path, act: Callable[[Counter], None], part: str = "DD", *more: str) -> str:
    """Let something happen to parts, end the robot, and ask."""
    write_sample(folder / "robot.toml")
    library = load_library()
    put_database(folder / "robot.db")
    with open_registry(folder / "robot.db") as registry:
        robot = registry.robots.apply_blueprint(load_blueprint(folder / "robot.toml", library), library)
        act(Counter(registry, robot))
    done = CliRunner().invoke(why_command, [part, "--db", str(folder / "robot.db"), *more], catch_exceptions=False)
    assert done.exit_code == 0
    return done.stdout


def unknown_part(counter: Counter) -> None:
    counter.claim("NOPE")


def blocked_part(counter: Counter) -> None:
    counter.claim("EFGH")
    Hand(counter.registry).block(counter.robot, "uid", EFGH.hex(), "smells of smoke", "ann")
    counter.inventory.blocks_changed(counter.now)


def blocked_number(counter: Counter) -> None:
    Hand(counter.registry).block(counter.robot, "number", "EFGH", "recalled", "ann")
    counter.claim("EFGH")


def duplicate(counter: Counter) -> None:
    counter.inventory.on_event(lambda _: None)
    first = counter.claim("EFGH", name="BB")
    second = counter.claim("EFGH")
    counter.now += 1.0
    counter.again("EFGH", first, name="BB")
    counter.again("EFGH", second)


def every_slot_taken(counter: Counter) -> None:
    counter.claim("EFGH", uid=b"EFGH-two", name="BB")
    counter.claim("EFGH")


def wrong_robot(counter: Counter) -> None:
    others = (part for part in load_library() if {part.number, *part.compatible_with}.isdisjoint(RING))
    counter.claim(next(others).number)


def control_characters(counter: Counter) -> None:
    counter.claim("EF\x1bGH")


def no_part_number(counter: Counter) -> None:
    counter.claim("")


def unreadable_registry(counter: Counter) -> None:
    def fail(_: str) -> None:
        raise RegistryError("the database robot.db is locked by another program")

    counter.store.part_type = fail  # type: ignore[method-assign, assignment]
    counter.claim("EFGH")


def no_key(counter: Counter) -> None:
    counter.ask()


def wrong_key(counter: Counter) -> None:
    counter.registry.keys.store(EFGH, KEY, "ann")
    nonce = counter.ask()
    counter.show(prove(bytes(16), nonce, EFGH, part_number="EFGH", local_name="DD", session_key=77))


def replayed(counter: Counter) -> None:
    counter.registry.keys.store(EFGH, KEY, "ann")
    old = prove(KEY, counter.ask(), EFGH, part_number="EFGH", local_name="DD", session_key=77)
    counter.show(old)
    counter.inventory.client_left(77, "session deleted", counter.now, politely=True)
    counter.ask(asker=b"another requester"[:16])
    counter.show(old, asker=b"another requester"[:16])


def never_proves(counter: Counter) -> None:
    counter.registry.keys.store(EFGH, KEY, "ann")
    counter.ask()
    counter.now += UNANSWERED_S + 1
    claim = pnp_messages.ClaimMessage(part_number="EFGH", local_name="DD", uid=EFGH, session_nonce=1)
    counter.requests.compact(claim.encode(), 77, counter.now, bytes(16))


def programs_without_keys(counter: Counter) -> None:
    counter.inventory.client_joined(77, "peer 77", counter.now)
    counter.requests.compat(thesis_messages.encode_request("EFGH", "DD"), 77, counter.now)


REASONS: dict[Callable[[Counter], None], tuple[Refusal, str]] = {
    unknown_part: (Refusal.UNKNOWN_PART, "checking -> refused: part number NOPE is not in the library"),
    blocked_part: (Refusal.BLOCKED, "active -> refused: blocked: smells of smoke"),
    blocked_number: (Refusal.BLOCKED, "checking -> refused: blocked: recalled"),
    duplicate: (
        Refusal.DUPLICATE,
        "checking -> refused: another part with the same UID is active: BB in slot BB, from peer 1",
    ),
    every_slot_taken: (Refusal.NO_SLOT, "checking -> standby: every fitting slot is taken"),
    wrong_robot: (Refusal.WRONG_ROBOT, "is known, but this robot has no slot for it"),
    control_characters: (Refusal.BAD_CLAIM, "checking -> refused: a text of the claim holds control characters"),
    no_part_number: (Refusal.BAD_CLAIM, "checking -> refused: the claim has no part number"),
    unreadable_registry: (
        Refusal.NOT_READY,
        "the inventory cannot read its registry: the database robot.db is locked by another program",
    ),
    no_key: (Refusal.NO_KEY, "this robot asks for keys, and has none for this part (none is on file for UID"),
    wrong_key: (Refusal.WRONG_KEY, "the part's key is not the one on file for its UID"),
    replayed: (Refusal.REPLAYED, "an old proof was shown again, or one that nobody asked for"),
    never_proves: (Refusal.KEY_NEEDED, "this robot asks for keys, and the part proves none (asked 6.0 s ago"),
    programs_without_keys: (Refusal.KEY_NEEDED, "the programs of the thesis know no keys"),
}


@pytest.mark.parametrize("act", REASONS, ids=lambda act: act.__name__)
def test_every_reason_to_turn_a_part_away_is_said(act: Callable[[Counter], None], tmp_path: Path) -> None:
    _, words = REASONS[act]
    assert words in why(tmp_path, act)


def test_no_reason_is_left_out() -> None:
    assert {refusal for refusal, _ in REASONS.values()} == set(Refusal)


def test_the_rules_are_told_in_the_order_in_which_they_were_tried(tmp_path: Path) -> None:
    lines = why(tmp_path, every_slot_taken).splitlines()
    rules = [line.strip(" -").partition(":")[0] for line in lines if line.startswith("  - ")]
    assert rules == ["claim", "library", "blocked", "slots", "same UID as before", "slot"]
    assert "  - library: EFGH: Toggle switch" in lines


def test_a_part_that_no_slot_is_clear_for_is_told_to_wait_for_a_person(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        await asyncio.sleep(0)

    said = _why_after(tmp_path, scene, ('part = "WXYZ"', 'part = "EFGH"'), parts=("DD=EFGH",))
    assert "2 free slots fit and local name 'DD' names none of them: a person must say" in said


def test_a_spare_that_takes_over_says_from_whom_and_why(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        stage.pull("BB")
        await asyncio.sleep(1.0)

    said = _why_after(tmp_path, scene, parts=("BB=EFGH", "DD=EFGH"))
    assert "DD: standby -> active in slot BB: takes over slot BB: BB is lost (gone: closed)" in said


def test_what_people_do_is_said_with_who_did_it(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        await stage.do.release("BB", who="ann")
        await asyncio.sleep(6.0)
        await stage.do.adopt("DD", "BB", who="bob")

    said = _why_after(tmp_path, scene, parts=("DD=EFGH",))
    assert "DD: active -> standby: was in slot BB: ann released slot BB" in said
    assert "DD: standby -> active in slot BB: bob adopted it into slot BB" in said


def test_silence_is_said_with_the_rule_that_counts_it(tmp_path: Path) -> None:
    def fall_silent(counter: Counter) -> None:
        counter.claim("EFGH")
        while counter.now < 107.0:
            counter.now = counter.inventory.timer()
            counter.inventory.handle_timer(counter.now)

    said = why(tmp_path, fall_silent)
    assert "active -> late in slot BB: no beat for 2.0 s" in said
    assert "late -> lost in slot BB: no beat for 6.0 s: life status 0" in said
    assert "  - 3 ticks of 2 s without a beat: no beat for 6.0 s" in said


def test_a_part_that_was_never_there_is_a_mistake_with_the_names_of_those_that_were(tmp_path: Path) -> None:
    why(tmp_path, unknown_part)
    with pytest.raises(Exception, match="no part 'XX' is in the journal; seen so far: DD"):
        CliRunner().invoke(why_command, ["XX", "--db", str(tmp_path / "robot.db")], catch_exceptions=False)


def test_a_typo_in_the_name_of_a_slot_is_told(tmp_path: Path) -> None:
    why(tmp_path, unknown_part)
    with pytest.raises(Exception, match=r"no part 'AAA' is in the journal; did you mean AA\?"):
        CliRunner().invoke(why_command, ["AAA", "--db", str(tmp_path / "robot.db")], catch_exceptions=False)


def test_a_slot_that_was_never_filled_is_told_as_that(tmp_path: Path) -> None:
    assert "no part has ever been in slot AA; `msbot simulate AA`" in why(tmp_path, unknown_part, "aa")
    asked = ["AA", "--db", str(tmp_path / "robot.db"), "--json"]
    told = json.loads(CliRunner().invoke(why_command, asked, catch_exceptions=False).stdout)
    assert (told["history"], told["now"][0][:38]) == ([], "no part has ever been in slot AA; `msb")


def test_the_part_that_holds_the_slot_is_spoken_of_first(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        await stage.do.release("BB", who="ann")
        await asyncio.sleep(6.0)
        found = stage.master.inventory.find("BB", asyncio.get_running_loop().time())
        assert [one.part for one in found] == ["DD", "BB"]
        assert stage.master.why("bb")[0].startswith("DD")

    play(tmp_path, scene, parts=("BB=EFGH", "DD=EFGH"))


def test_in_a_database_of_several_robots_the_one_that_is_named_answers(tmp_path: Path) -> None:
    why(tmp_path, unknown_part)
    (tmp_path / "rex.toml").write_text('[robot]\nname = "Rex"\n[[slot]]\nname = "AA"\npart = "ABCD"\n')
    library = load_library()
    with open_registry(tmp_path / "robot.db") as registry:
        rex = registry.robots.apply_blueprint(load_blueprint(tmp_path / "rex.toml", library), library)
        Counter(registry, rex).claim("ABCD", name="DD")

    def ask(*more: str) -> str:
        asked = ["DD", "--db", str(tmp_path / "robot.db"), *more]
        return CliRunner().invoke(why_command, asked, catch_exceptions=False).stdout

    assert "part number ABCD" in ask("--robot", "Rex")
    assert "part number ABCD" not in ask("--robot", "MSBOT_MASTER")
    assert "  Rex: DD: " in ask("--last", "9")
    assert "  MSBOT_MASTER: DD: " in ask("--last", "9")
    with pytest.raises(ConfigError, match=r"has no robot 'X'; there are"):
        ask("--robot", "X")


def _why_after(
    folder: Path, scene: Callable[[Stage], Awaitable[None]], *changes: tuple[str, str], parts: tuple[str, ...]
) -> str:
    play(folder, scene, *changes, parts=parts)
    done = CliRunner().invoke(why_command, ["DD", "--db", str(folder / "robot.db")], catch_exceptions=False)
    return done.stdout
