"""How a part joins a robot: two steps, then beats. Pure: time and news in, actions out.

Theory of operation. A part says nothing about itself until it has heard the robot's profile and found that this is the
robot it is made for (step 1, thesis 3.12.1). Then it claims its place with its part number (step 2, thesis 3.12.2)
until somebody answers; an unknown part gets no answer, and a robot with keys asks for a proof first. With the lease it
fetches its configuration, and only then is it active: nothing is published before. From the lease on it sends beats;
after an unanswered beat it checks the agent at once, when the inventory no longer knows its lease it claims again, and
when the inventory is silent for three and a half beats the part is lost and begins again with a new session (thesis
3.10.3, 3.12.1.1).

The owner feeds in the news (`session_opened`, `profile_seen`, ...), calls `next_action()` after each until it returns
None, and calls `handle_timer` when `timer()` says so.
"""

from __future__ import annotations

from enum import Enum

from msbot_xrce.lazy import dataclass


class JoinState(Enum):
    """The state of a part; the value is the word a person reads."""

    LOOKING = "looking"
    RECOGNISING = "recognising"
    CLAIMING = "claiming"
    CONFIGURING = "configuring"
    ACTIVE = "active"
    LOST = "lost"
    REFUSED = "refused"
    WRONG_ROBOT = "wrong robot"
    ENDED = "ended"


class JoinEvent(Enum):
    """What makes a part change its state."""

    AGENT_FOUND = "the agent opened a session"
    AGENT_LOST = "the session with the agent ended"
    PROFILE_AGREES = "the profile is that of the expected robot"
    PROFILE_DISAGREES = "the profile is that of another robot"
    LEASE_GIVEN = "the inventory registered the part"
    CLAIM_REFUSED = "the inventory refused the part"
    CONFIGURED = "the configuration has arrived"
    LEASE_UNKNOWN = "the inventory does not know the lease"
    INVENTORY_SILENT = "the inventory answers no beats"
    END = "the part was told to end"


S, E = JoinState, JoinEvent

TRANSITIONS: dict[tuple[JoinState, JoinEvent], JoinState] = {
    (S.LOOKING, E.AGENT_FOUND): S.RECOGNISING,
    (S.RECOGNISING, E.PROFILE_AGREES): S.CLAIMING,
    (S.RECOGNISING, E.PROFILE_DISAGREES): S.WRONG_ROBOT,
    (S.CLAIMING, E.PROFILE_DISAGREES): S.WRONG_ROBOT,
    (S.CLAIMING, E.LEASE_GIVEN): S.CONFIGURING,
    (S.CLAIMING, E.CLAIM_REFUSED): S.REFUSED,
    (S.REFUSED, E.PROFILE_DISAGREES): S.WRONG_ROBOT,
    (S.REFUSED, E.LEASE_GIVEN): S.CONFIGURING,
    (S.CONFIGURING, E.PROFILE_DISAGREES): S.WRONG_ROBOT,
    (S.CONFIGURING, E.CONFIGURED): S.ACTIVE,
    (S.CONFIGURING, E.LEASE_UNKNOWN): S.CLAIMING,
    (S.CONFIGURING, E.INVENTORY_SILENT): S.LOST,
    (S.ACTIVE, E.PROFILE_DISAGREES): S.WRONG_ROBOT,
    (S.ACTIVE, E.LEASE_UNKNOWN): S.CLAIMING,
    (S.ACTIVE, E.INVENTORY_SILENT): S.LOST,
    (S.WRONG_ROBOT, E.PROFILE_AGREES): S.CLAIMING,
    (S.LOST, E.AGENT_FOUND): S.RECOGNISING,
    **{
        (state, E.AGENT_LOST): S.LOST
        for state in (S.RECOGNISING, S.CLAIMING, S.REFUSED, S.CONFIGURING, S.ACTIVE, S.WRONG_ROBOT)
    },
    **{(state, E.END): S.ENDED for state in JoinState if state is not S.ENDED},
}
"""Every change there is; an event that is not listed for a state leaves it as it is."""

REFUSED_RETRY_S = 2.0
"""Time between two claims after an explicit refusal."""

UNANSWERED_S = 4.0
"""After so long without an answer to a claim, the master may be one that knows no claims."""


@dataclass(frozen=True, slots=True)
class Pace:
    """How quickly a part asks again."""

    retry_s: float = 0.5
    """Time between two claims, and between two requests for the configuration, until an answer comes."""
    answer_s: float = 0.5
    """A beat without an answer for this long counts as missed."""
    silent_beats: float = 3.5
    """Number of beat periods without any answer after which the inventory counts as gone."""


QUICK = Pace()
PATIENT = Pace(retry_s=2.0, answer_s=1.0, silent_beats=12.0)
"""For a slow shared medium: questions of many would fill it, and the link itself notices when the master goes."""

ANY = "*"
"""In an `ExpectedRobot`: whatever the profile says."""


@dataclass(frozen=True, slots=True)
class ExpectedRobot:
    """The robot a part is made for; `*` in a field = any."""

    name: str = ANY
    version: str = ANY
    serial_number: str = ANY
    manufacturer: str = ANY

    def disagreement(self, seen: ExpectedRobot) -> str | None:
        """Why the robot that was seen is not this one, in words; None when it is."""
        for word, mine, theirs in (
            ("name", self.name, seen.name),
            ("version", self.version, seen.version),
            ("serial number", self.serial_number, seen.serial_number),
            ("manufacturer", self.manufacturer, seen.manufacturer),
        ):
            if mine not in (ANY, theirs):
                return f"this robot's {word} is {theirs!r}, the part expects {mine!r}"
        return None


@dataclass(frozen=True, slots=True)
class SendClaim:
    """Send the registration request."""


@dataclass(frozen=True, slots=True)
class AskThesisMaster:
    """Nobody answers: ask whether this is the master of the thesis' own programs."""


@dataclass(frozen=True, slots=True)
class SendProof:
    """Answer the inventory's challenge."""

    nonce: bytes
    sealed: bool = False
    """The robot seals its samples, so the proof has another form."""


@dataclass(frozen=True, slots=True)
class SendBeat:
    """Send one beat."""

    lease: int


@dataclass(frozen=True, slots=True)
class FetchConfiguration:
    """Ask for the configuration."""

    lease: int
    have_version: int
    """Version of the one in use, 0 = none."""


@dataclass(frozen=True, slots=True)
class CheckAgent:
    """Find out whether the agent is still there and knows us."""


@dataclass(frozen=True, slots=True)
class BeginAnew:
    """Give the session up and open another one."""

    reason: str


@dataclass(frozen=True, slots=True)
class Changed:
    """The state has changed."""

    at: float
    before: JoinState
    after: JoinState
    reason: str
    """Why, in words."""


Action = SendClaim | AskThesisMaster | SendProof | SendBeat | FetchConfiguration | CheckAgent | BeginAnew | Changed

_CLAIMS = (S.CLAIMING, S.REFUSED)
_BEATS = (S.CONFIGURING, S.ACTIVE)


class Joining:
    """The state of one part (see the module's docstring)."""

    def __init__(self, expected: ExpectedRobot, pace: Pace = QUICK) -> None:
        self.state = JoinState.LOOKING
        self.reason = "looking for an agent"
        """Why the part is in its state, in words."""
        self.beats = 0
        """Beats that were answered."""
        self.missed_beats = 0
        """Beats that were not answered in time."""
        self.configuration_version = 0
        """Version of the configuration in use, 0 = none."""
        self.robot = ExpectedRobot()
        """The robot that was recognised last."""
        self.lease = 0
        """The number that every beat shows, 0 = not registered."""
        self._expected = expected
        self._pace = pace
        self._actions: list[Action] = []
        self._beat_period_s = 1.0
        self._retry_at: float | None = None
        self._beat_at: float | None = None
        self._waiting_since: float | None = None
        self._heard_at = 0.0
        self._claims_since = 0.0
        self._has_asked = False

    def next_action(self) -> Action | None:
        """The next thing that the owner has to do, or None."""
        return self._actions.pop(0) if self._actions else None

    def session_opened(self, now: float) -> None:
        """A session is open."""
        self._take(E.AGENT_FOUND, "agent found, waiting for the robot's profile", now)

    def agent_lost(self, reason: str, now: float) -> None:
        """There is no session; all that was agreed in it is void."""
        if self.state in (S.LOOKING, S.LOST):
            self.reason = reason
        self._take(E.AGENT_LOST, reason, now)

    def profile_seen(self, robot: ExpectedRobot, now: float) -> None:
        """The master's profile has arrived (step 1)."""
        disagreement = self._expected.disagreement(robot)
        if disagreement is None:
            self.robot = robot
            self._take(E.PROFILE_AGREES, f"recognised robot {robot.name}", now)
        else:
            self._take(E.PROFILE_DISAGREES, disagreement, now)

    def challenged(self, nonce: bytes, now: float, *, sealed: bool = False) -> None:
        """The inventory wants a proof before it decides on the claim; the answer is due at once."""
        self._heard_at = now
        if self.state in _CLAIMS:
            self._actions.append(SendProof(nonce, sealed))
            self._retry_at = now + self._pace.retry_s

    def verdict_given(self, lease: int, beat_period_s: float, refusal: str, now: float) -> None:
        """The inventory has answered a claim (step 2): a lease, or 0 and why not in words.

        A second verdict with the same lease (the claim was repeated on a slow bus) changes nothing; one with another
        lease means that the part has been given another slot, whose configuration it has to fetch.
        """
        self._heard_at = now
        if lease == 0:
            if self.state is S.REFUSED and self.reason != refusal:
                self.reason = refusal
                self._actions.append(Changed(now, S.REFUSED, S.REFUSED, refusal))
            self._take(E.CLAIM_REFUSED, refusal, now)
            if self.state is S.REFUSED:
                self._retry_at = now + REFUSED_RETRY_S
        elif self.state in _CLAIMS or self.state in _BEATS:
            is_moved = self.state is S.ACTIVE and lease != self.lease
            self.lease = lease
            self._beat_period_s = beat_period_s
            self._take(E.LEASE_GIVEN, "registered, fetching the configuration", now)
            if is_moved:
                self.configuration_version = 0  # two slots may have the same version
                self._fetch_configuration(now)

    def thesis_master_found(self, words: str, now: float) -> None:
        """The master of the thesis' own programs has answered; the part says so, and stays in case that another one
        comes."""
        if self.state is S.CLAIMING and self.reason != words:
            self.reason = words
            self._actions.append(Changed(now, S.CLAIMING, S.CLAIMING, words))

    def configuration_received(self, version: int, slot: str, now: float) -> bool:
        """A configuration has arrived; True = put it into use (before the next `next_action`)."""
        if self.state not in _BEATS:
            return False
        self._heard_at = now
        if self.state is S.ACTIVE:
            self._retry_at = None
        news = self.state is S.CONFIGURING or version != self.configuration_version
        self.configuration_version = version
        self._take(E.CONFIGURED, f"in slot {slot}", now)
        return news

    def beat_answered(self, configuration_version: int, now: float) -> None:
        """The inventory has answered a beat; 0 = it does not know the lease."""
        if self.state not in _BEATS:
            return
        self._waiting_since = None
        self._heard_at = now
        if configuration_version == 0:
            self._take(E.LEASE_UNKNOWN, "the inventory does not know this part any more", now)
            return
        self.beats += 1
        if self.state is S.ACTIVE and configuration_version != self.configuration_version and self._retry_at is None:
            self._fetch_configuration(now)

    def beat_soon(self, now: float) -> None:
        """Send a beat at once, in addition to the regular ones: somebody is waiting for a sign."""
        if self.state in _BEATS:
            self._beat(now)

    def end(self, reason: str, now: float) -> None:
        """The part ends; it never leaves this state."""
        self._take(E.END, reason, now)

    def timer(self) -> float | None:
        """When `handle_timer` wants to be called next, or None."""
        times = [self._retry_at, self._beat_at]
        if self._waiting_since is not None:
            times.append(self._waiting_since + self._pace.answer_s)
        return min((time for time in times if time is not None), default=None)

    def handle_timer(self, now: float) -> None:
        """Do what is due: claim, fetch, send a beat, notice a missed beat."""
        if self._retry_at is not None and now >= self._retry_at:
            if self.state in _CLAIMS:
                self._claim(now)
            else:
                self._fetch_configuration(now)
        if self._waiting_since is not None and now >= self._waiting_since + self._pace.answer_s:
            self._beat_missed(now)
        if self._beat_at is not None and now >= self._beat_at:
            self._beat_at += self._beat_period_s
            if self._beat_at <= now:
                self._beat_at = now + self._beat_period_s
            self._beat(now)

    def _take(self, event: JoinEvent, reason: str, now: float) -> None:
        after = TRANSITIONS.get((self.state, event))
        if after is None:
            return
        before, self.state, self.reason = self.state, after, reason
        self._actions.append(Changed(now, before, after, reason))
        self._enter(after, now)

    def _enter(self, state: JoinState, now: float) -> None:
        self._retry_at = None
        if state not in _BEATS:
            self.lease = 0
            self.configuration_version = 0
            self._beat_at = self._waiting_since = None
        if state is S.CLAIMING:
            self._claims_since, self._has_asked = now, False
            self._claim(now)
        elif state is S.REFUSED:
            self._retry_at = now + REFUSED_RETRY_S
        elif state is S.CONFIGURING:
            self._beat_at = now + self._beat_period_s
            self._fetch_configuration(now)

    def _claim(self, now: float) -> None:
        self._actions.append(SendClaim())
        if self.state is S.CLAIMING and not self._has_asked and now - self._claims_since >= UNANSWERED_S:
            self._has_asked = True
            self._actions.append(AskThesisMaster())
        self._retry_at = now + (self._pace.retry_s if self.state is S.CLAIMING else REFUSED_RETRY_S)

    def _fetch_configuration(self, now: float) -> None:
        self._actions.append(FetchConfiguration(self.lease, self.configuration_version))
        self._retry_at = now + self._pace.retry_s

    def _beat(self, now: float) -> None:
        self._actions.append(SendBeat(self.lease))
        if self._waiting_since is None:
            self._waiting_since = now

    def _beat_missed(self, now: float) -> None:
        self.missed_beats += 1
        self._waiting_since = None
        if now - self._heard_at >= self._pace.silent_beats * self._beat_period_s:
            reason = "the inventory has not answered any beat lately"
            self._take(E.INVENTORY_SILENT, reason, now)
            # The agent may still be there: a session whose streams are out of step looks the same from here.
            self._actions.append(BeginAnew(reason))
            return
        self._actions.append(CheckAgent())
        self._beat(now)
