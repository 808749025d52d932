"""The two steps, the beats, and every way to lose and regain the robot: literal times, no loop."""

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from msbot.part.join.joining import (
    PATIENT,
    TRANSITIONS,
    Action,
    BeginAnew,
    Changed,
    CheckAgent,
    ExpectedRobot,
    FetchConfiguration,
    JoinEvent,
    Joining,
    JoinState,
    SendBeat,
    SendClaim,
    SendProof,
)
from tests.effort import tries

ROBOT = ExpectedRobot("MSBOT_MASTER", "MSBOT_V1", "X100", "MASSEY")
OTHER = ExpectedRobot("OTHER", "MSBOT_V1", "X100", "MASSEY")


def actions(joining: Joining) -> list[Action]:
    taken = []
    while (action := joining.next_action()) is not None:
        taken.append(action)
    return taken


def changes(taken: list[Action]) -> list[tuple[JoinState, JoinState]]:
    return [(action.before, action.after) for action in taken if isinstance(action, Changed)]


def active(now: float = 0.0) -> Joining:
    joining = Joining(ExpectedRobot("MSBOT_MASTER"))
    joining.session_opened(now)
    joining.profile_seen(ROBOT, now)
    joining.verdict_given(7, 1.0, "", now)
    assert joining.configuration_received(3, "A", now)
    actions(joining)
    return joining


def test_a_part_goes_through_both_steps_and_its_configuration() -> None:
    joining = Joining(ExpectedRobot("MSBOT_MASTER"))
    assert joining.state is JoinState.LOOKING
    joining.session_opened(1.0)
    assert changes(actions(joining)) == [(JoinState.LOOKING, JoinState.RECOGNISING)]
    joining.profile_seen(ROBOT, 1.1)
    taken = actions(joining)
    assert changes(taken) == [(JoinState.RECOGNISING, JoinState.CLAIMING)]
    assert SendClaim() in taken
    joining.verdict_given(7, 1.0, "", 1.2)
    taken = actions(joining)
    assert changes(taken) == [(JoinState.CLAIMING, JoinState.CONFIGURING)]
    assert FetchConfiguration(7, 0) in taken
    assert joining.configuration_received(3, "A", 1.3)
    assert changes(actions(joining)) == [(JoinState.CONFIGURING, JoinState.ACTIVE)]
    assert joining.reason == "in slot A"
    assert joining.timer() == 2.2


def test_a_challenge_is_answered_at_once_while_claiming_and_at_no_other_time() -> None:
    joining = Joining(ExpectedRobot())
    joining.challenged(b"early", 0.0)
    joining.session_opened(0.0)
    joining.challenged(b"early", 0.0)
    joining.profile_seen(ROBOT, 0.0)
    actions(joining)
    joining.challenged(b"now", 0.1)
    assert actions(joining) == [SendProof(b"now")]
    assert joining.timer() == 0.6, "the claim is repeated when nothing comes of it"
    joining.verdict_given(0, 1.0, "wrong key", 0.2)
    actions(joining)
    joining.challenged(b"again", 2.2)
    assert actions(joining) == [SendProof(b"again")]
    late = active()
    late.challenged(b"late", 0.1)
    assert actions(late) == []


def test_an_extra_beat_goes_out_at_once_and_leaves_the_others_in_their_time() -> None:
    joining = active()
    due_at = joining.timer()
    joining.beat_soon(0.4)
    assert actions(joining) == [SendBeat(7)]
    joining.beat_answered(3, 0.41)
    assert joining.timer() == due_at == 1.0
    idle = Joining(ExpectedRobot())
    idle.beat_soon(0.0)
    assert actions(idle) == []


def test_nothing_is_claimed_before_the_profile_was_heard() -> None:
    joining = Joining(ExpectedRobot())
    joining.session_opened(0.0)
    actions(joining)
    joining.handle_timer(100.0)
    joining.verdict_given(7, 1.0, "", 100.0)
    assert not joining.configuration_received(1, "A", 100.0)
    joining.beat_answered(1, 100.0)
    assert actions(joining) == []
    assert joining.timer() is None


def test_another_robot_is_never_claimed_until_its_profile_changes() -> None:
    joining = Joining(ExpectedRobot("MSBOT_MASTER"))
    joining.session_opened(0.0)
    actions(joining)
    joining.profile_seen(OTHER, 0.1)
    assert changes(actions(joining)) == [(JoinState.RECOGNISING, JoinState.WRONG_ROBOT)]
    assert joining.reason == "this robot's name is 'OTHER', the part expects 'MSBOT_MASTER'"
    assert joining.timer() is None
    joining.profile_seen(ROBOT, 5.1)
    assert SendClaim() in actions(joining)


def test_an_active_part_leaves_a_robot_that_becomes_another() -> None:
    joining = active()
    joining.profile_seen(OTHER, 5.0)
    assert changes(actions(joining)) == [(JoinState.ACTIVE, JoinState.WRONG_ROBOT)]
    assert joining.timer() is None


def test_every_field_of_the_profile_counts_and_a_star_is_any() -> None:
    assert ExpectedRobot().disagreement(ROBOT) is None
    assert ROBOT.disagreement(ROBOT) is None
    for field, word in (
        ("name", "name"),
        ("version", "version"),
        ("serial_number", "serial number"),
        ("manufacturer", "manufacturer"),
    ):
        expected = ExpectedRobot(**{field: "x"})
        assert word in (expected.disagreement(ROBOT) or "")


def test_a_claim_is_repeated_every_half_second_until_answered() -> None:
    joining = Joining(ExpectedRobot())
    joining.session_opened(0.0)
    joining.profile_seen(ROBOT, 0.0)
    actions(joining)
    for turn in range(1, 4):
        assert joining.timer() == turn * 0.5
        joining.handle_timer(turn * 0.5)
        assert actions(joining) == [SendClaim()]
    joining.verdict_given(1, 1.0, "", 1.6)
    joining.handle_timer(2.1)
    assert SendClaim() not in actions(joining)


def test_a_refusal_is_told_and_claimed_again_later() -> None:
    joining = Joining(ExpectedRobot())
    joining.session_opened(0.0)
    joining.profile_seen(ROBOT, 0.0)
    actions(joining)
    joining.verdict_given(0, 1.0, "blocked by an administrator", 0.1)
    assert changes(actions(joining)) == [(JoinState.CLAIMING, JoinState.REFUSED)]
    assert joining.reason == "blocked by an administrator"
    assert joining.timer() == 2.1
    joining.handle_timer(2.1)
    assert actions(joining) == [SendClaim()]
    joining.verdict_given(0, 1.0, "no free slot", 2.2)
    assert changes(actions(joining)) == [(JoinState.REFUSED, JoinState.REFUSED)], "another reason is news"
    joining.verdict_given(0, 1.0, "no free slot", 2.3)
    assert actions(joining) == []
    assert joining.reason == "no free slot"
    joining.verdict_given(5, 1.0, "", 4.3)
    assert changes(actions(joining)) == [(JoinState.REFUSED, JoinState.CONFIGURING)]


def test_the_configuration_is_asked_for_until_it_comes() -> None:
    joining = Joining(ExpectedRobot())
    joining.session_opened(0.0)
    joining.profile_seen(ROBOT, 0.0)
    joining.verdict_given(7, 1.0, "", 0.0)
    actions(joining)
    joining.handle_timer(0.5)
    assert actions(joining) == [FetchConfiguration(7, 0)]
    joining.handle_timer(1.0)
    assert actions(joining) == [FetchConfiguration(7, 0), SendBeat(7)]


def test_a_second_verdict_with_the_same_lease_changes_nothing() -> None:
    joining = active()
    joining.verdict_given(7, 1.0, "", 0.5)
    assert actions(joining) == []
    joining.handle_timer(1.0)
    assert actions(joining) == [SendBeat(7)]
    joining.verdict_given(0, 1.0, "refused", 1.1)
    assert joining.state is JoinState.ACTIVE


def test_another_lease_means_another_slot_whose_configuration_is_fetched_even_of_the_same_version() -> None:
    joining = active()
    version = joining.configuration_version
    joining.verdict_given(8, 1.0, "", 0.5)
    assert actions(joining) == [FetchConfiguration(8, 0)]
    assert joining.configuration_received(version, "CC", 0.6)
    joining.handle_timer(1.0)
    assert actions(joining) == [SendBeat(8)]


def test_beats_go_out_every_period_without_drift() -> None:
    joining = active()
    for beat in range(1, 4):
        assert joining.timer() == float(beat)
        joining.handle_timer(beat + 0.01)
        assert actions(joining) == [SendBeat(7)]
        joining.beat_answered(3, beat + 0.02)
    assert joining.beats == 3
    assert joining.missed_beats == 0


def test_after_a_long_pause_there_is_one_beat_not_many() -> None:
    joining = active()
    joining.handle_timer(10.0)
    assert actions(joining) == [SendBeat(7)]
    joining.beat_answered(3, 10.1)
    assert joining.timer() == 11.0


def test_a_missed_beat_looks_after_the_agent_and_beats_again() -> None:
    joining = active()
    joining.handle_timer(1.0)
    actions(joining)
    assert joining.timer() == 1.5
    joining.handle_timer(1.5)
    assert actions(joining) == [CheckAgent(), SendBeat(7)]
    assert joining.missed_beats == 1
    joining.beat_answered(3, 1.6)
    assert joining.state is JoinState.ACTIVE


def test_a_silent_inventory_is_left_after_three_and_a_half_beats() -> None:
    joining = active()
    now = 0.0
    while joining.state is JoinState.ACTIVE:
        now = joining.timer() or 0.0
        joining.handle_timer(now)
    assert 3.5 <= now <= 4.0
    taken = actions(joining)
    assert changes(taken) == [(JoinState.ACTIVE, JoinState.LOST)]
    assert taken[-1] == BeginAnew("the inventory has not answered any beat lately")
    assert joining.lease == 0
    assert joining.timer() is None


def test_where_many_share_a_slow_medium_it_asks_less_often() -> None:
    joining = Joining(ExpectedRobot(), PATIENT)
    joining.session_opened(0.0)
    joining.profile_seen(ROBOT, 0.0)
    assert joining.timer() == 2.0
    joining.verdict_given(7, 1.0, "", 0.0)
    joining.configuration_received(1, "A", 0.0)
    joining.handle_timer(1.0)
    joining.handle_timer(1.9)
    assert joining.missed_beats == 0
    now = 0.0
    while joining.state is JoinState.ACTIVE:
        now = joining.timer() or 0.0
        joining.handle_timer(now)
    assert 12.0 <= now <= 13.0


def test_an_unknown_lease_makes_it_claim_again() -> None:
    joining = active()
    joining.handle_timer(1.0)
    actions(joining)
    joining.beat_answered(0, 1.1)
    taken = actions(joining)
    assert changes(taken) == [(JoinState.ACTIVE, JoinState.CLAIMING)]
    assert SendClaim() in taken
    joining.verdict_given(9, 1.0, "", 1.2)
    assert FetchConfiguration(9, 0) in actions(joining)


def test_a_new_configuration_is_fetched_without_leaving_active() -> None:
    joining = active()
    joining.handle_timer(1.0)
    actions(joining)
    joining.beat_answered(4, 1.1)
    assert actions(joining) == [FetchConfiguration(7, 3)]
    joining.beat_answered(4, 1.2)
    assert actions(joining) == []
    joining.handle_timer(1.6)
    assert actions(joining) == [FetchConfiguration(7, 3)]
    assert joining.configuration_received(4, "A", 1.7)
    assert not joining.configuration_received(4, "A", 1.8)
    assert actions(joining) == []
    assert joining.state is JoinState.ACTIVE


def test_a_lost_agent_voids_everything_and_both_steps_begin_again() -> None:
    joining = active()
    joining.agent_lost("the agent does not answer", 2.0)
    taken = actions(joining)
    assert taken == [Changed(2.0, JoinState.ACTIVE, JoinState.LOST, "the agent does not answer")]
    assert joining.timer() is None
    assert joining.lease == 0
    joining.agent_lost("still no agent", 3.0)
    assert joining.reason == "still no agent"
    joining.session_opened(4.0)
    assert joining.state is JoinState.RECOGNISING
    assert SendClaim() not in actions(joining)


def test_the_end_is_the_end() -> None:
    joining = active()
    joining.end("ended", 2.0)
    assert changes(actions(joining)) == [(JoinState.ACTIVE, JoinState.ENDED)]
    joining.session_opened(3.0)
    joining.profile_seen(ROBOT, 3.0)
    joining.end("again", 3.0)
    assert actions(joining) == []


def test_the_table_of_transitions_leads_everywhere_and_stopped_is_final() -> None:
    reached = {JoinState.LOOKING}
    while new := {after for (before, _), after in TRANSITIONS.items() if before in reached} - reached:
        reached |= new
    assert reached == set(JoinState)
    assert {event for _, event in TRANSITIONS} == set(JoinEvent)
    assert not any(before is JoinState.ENDED for before, _ in TRANSITIONS)


class AnyNews(RuleBasedStateMachine):
    """Whatever comes in whatever order: claims only after step 1, active only with lease and configuration."""

    def __init__(self) -> None:
        super().__init__()
        self.joining = Joining(ExpectedRobot("MSBOT_MASTER"))
        self.now = 0.0
        self.recognised = False
        self.moved = False
        """Put into another slot while active, and still without that slot's configuration."""

    @rule()
    def session_opened(self) -> None:
        self.joining.session_opened(self.now)

    @rule()
    def agent_lost(self) -> None:
        self.joining.agent_lost("gone", self.now)
        self.recognised = False

    @rule(robot=st.sampled_from([ROBOT, OTHER]))
    def profile(self, robot: ExpectedRobot) -> None:
        if self.joining.state not in (JoinState.LOOKING, JoinState.LOST, JoinState.ENDED):
            self.recognised = robot is ROBOT
        self.joining.profile_seen(robot, self.now)

    @rule(lease=st.integers(0, 2))
    def verdict(self, lease: int) -> None:
        if self.joining.state is JoinState.ACTIVE and lease not in (0, self.joining.lease):
            self.moved = True
        self.joining.verdict_given(lease, 1.0, "no", self.now)

    @rule(version=st.integers(0, 3))
    def beat_reply(self, version: int) -> None:
        self.joining.beat_answered(version, self.now)

    @rule(version=st.integers(1, 3))
    def configuration(self, version: int) -> None:
        self.joining.configuration_received(version, "A", self.now)
        self.moved = False

    @rule(step=st.floats(0.0, 3.0))
    def time_passes(self, step: float) -> None:
        self.now += step
        timer = self.joining.timer()
        if timer is not None and timer <= self.now:
            self.joining.handle_timer(self.now)
            after = self.joining.timer()
            assert after is None or after > self.now

    @invariant()
    def actions_fit_the_state(self) -> None:
        for action in actions(self.joining):
            if isinstance(action, SendClaim):
                assert self.recognised
            if isinstance(action, Changed):
                assert (action.before, action.after) in {(before, after) for (before, _), after in TRANSITIONS.items()}
                assert action.reason
        if self.joining.state is JoinState.ACTIVE:
            assert self.recognised
            assert self.joining.lease
            assert self.joining.configuration_version or self.moved


TestAnyNews = AnyNews.TestCase
TestAnyNews.settings = settings(max_examples=tries(60, 2000), stateful_step_count=40, deadline=None)
