"""Carries a part's joining over a client: the profile's reader, the inventory's requester, and one timer.

`joining` decides, this file sends and receives. Claims and configurations travel reliably. Beats and their answers
travel best effort, because a late beat is worth nothing; so the replies are read on the reliable stream until the part
is active, and on best effort from then on.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence

from msbot.part.client.client import ENDLESS, ClientMaker, ServiceNames
from msbot.part.client.client_settings import ConnectionState, WorkScheduler
from msbot.part.client.entities import Entity
from msbot.part.join import pnp_messages, thesis_messages
from msbot.part.join.hardware_trouble import trouble_pieces
from msbot.part.join.joining import (
    AskThesisMaster,
    BeginAnew,
    Changed,
    CheckAgent,
    ExpectedRobot,
    FetchConfiguration,
    Joining,
    JoinState,
    SendBeat,
    SendClaim,
    SendProof,
)
from msbot.part.join.part_keys import KEY_VARIABLE
from msbot.part.join.part_log import LogLevel, LogSender, VersionOf
from msbot.part.join.part_seals import PartSeals
from msbot.part.join.refusal import IS_TOLD, Refusal
from msbot_agent.text.sentence import printable
from msbot_xrce.errors import LinkFull, LocalProtocolError, RemoteProtocolError
from msbot_xrce.messages import STREAM_BEST_EFFORT, STREAM_RELIABLE, DeliveryControl

INVENTORY = ServiceNames(
    pnp_messages.INVENTORY_SERVICE,
    pnp_messages.INVENTORY_REQUEST_TYPE,
    pnp_messages.INVENTORY_REPLY_TYPE,
    pnp_messages.INVENTORY_REQUEST_TOPIC,
    pnp_messages.INVENTORY_REPLY_TOPIC,
)
"""Where a part claims, beats and asks for its configuration."""
THESIS_INVENTORY = ServiceNames(
    thesis_messages.SERVICE,
    thesis_messages.REQUEST_TYPE,
    thesis_messages.REPLY_TYPE,
    f"{thesis_messages.SERVICE}_Request",
    f"{thesis_messages.SERVICE}_Reply",
)
"""Where the inventory of the thesis' own programs answers."""

ONE_SAMPLE = None
"""Delivery control of a read that ends with its first sample: none at all (seen on the wire)."""
NO_MORE = DeliveryControl(max_samples=0)
"""Delivery control that only ends the running read."""

TELL_S = 3.0
"""Longest time that a part stays for the robot to hear why it ends; on CAN, what was lost is asked for after 1 s."""

SHORTEST_BEAT_MS = 20
"""A master cannot ask for beats more often; a blueprint cannot either."""

_log = logging.getLogger(__name__)


class Membership:
    """One part's membership in one robot, over one client."""

    def __init__(
        self,
        make_client: ClientMaker,
        joining: Joining,
        claim: pnp_messages.ClaimMessage,
        *,
        profile_once: bool = False,
        prove: Callable[[bytes], bytes | None] = lambda _: None,
        prove_sealed: Callable[[bytes], tuple[bytes, bytes] | None] = lambda _: None,
        changed: Callable[[Changed], None],
        configure: Callable[[pnp_messages.ConfigurationMessage], None],
        noticed: Callable[[pnp_messages.Notice], None] = lambda _: None,
        on_topic: Callable[[int, int, bytes], None] = lambda *_: None,
        on_reply: Callable[[int, int, bytes], None] = lambda *_: None,
        stop_in_beats: Callable[[], tuple[int, ...]] = lambda: (),
        nature: pnp_messages.Nature = pnp_messages.Nature.UNKNOWN,
        hardware: str = "",
        software: str = "",
        home: str = "",
        description: str = "",
        absent: str = "",
    ) -> None:
        """Make the client and request what joining needs; `start` begins.

        Args:
            make_client: called with the callbacks that joining needs; the membership is alive while the `run` of the
                client that it makes is awaited.
            joining: in its first state.
            claim: what the part says about itself in step 2.
            profile_once: read the profile only until step 1 is done, because it takes time from others on the link, and
                the link itself reports when the robot is another one.
            prove: gives the answer to a challenge with that nonce; None = the part has no key.
            prove_sealed: gives the answer in a robot whose samples are sealed, and the secret for the seals.
            changed: called at every change of the state.
            configure: puts a configuration into use; called before `changed` reports `active`.
            noticed: called with what the inventory says unasked.
            on_topic: called with the samples that are not the robot's profile, as `Client.on_topic`.
            on_reply: called with the replies to requests of others than itself, as `Client.on_reply`.
            stop_in_beats: what its beats say of STOP, one after the other, as `StoppedBeat`; none: nothing.
            nature: what is behind the part's ports.
            hardware: version of the part's hardware; empty: it says none.
            software: version of its software.
            home: where it runs, as `home_text`; empty: it does not say.
            description: what the part says of itself to a robot that asks; empty: nothing.
            absent: why the part's hardware is not there. Then it asks for its place only to say so: it asks for no
                configuration, and never becomes active.
        """
        self.joining = joining
        self.dropped = 0
        """Profiles and replies that made no sense."""
        self.client = client = make_client(
            on_state=self._client_changed,
            on_reply=self._reply_received,
            on_topic=self._sample_received,
            on_room=self._say_on,
        )
        self._claim = claim.encode()
        self._question = thesis_messages.probe_request(claim.part_number, claim.local_name)
        self._thesis_requester: Entity | None = None
        self._profile_once = profile_once
        self._changed = changed
        self._configure = configure
        self._prove = prove
        self._prove_sealed = prove_sealed
        self.seals = PartSeals()
        """The seals of samples, in a robot that has them."""
        self._noticed = noticed
        self._on_topic = on_topic
        self._on_reply = on_reply
        self._stop_in_beats = stop_in_beats
        self._nature = nature
        versions = {VersionOf.SOFTWARE: software, VersionOf.HARDWARE: hardware}
        self._versions = (versions if software or hardware else {}) | ({VersionOf.HOME: home} if home else {})
        self._description = description
        self._absent = absent
        self._help = ""
        """What the robot has said last to the part that it does not let in."""
        self._unsaid: list[bytes] = []
        self._has_trouble = False
        self.log = LogSender()
        """Lines of the program for the robot's log."""
        self._end_reason = ""
        self._leaving: asyncio.TimerHandle | None = None
        """Set while it stays only to say what is unsaid."""
        self._turn = WorkScheduler(self._work)
        # Without a name: nobody learns who the part is before it has recognised its robot.
        self.participant = client.create_participant()
        """Parent of everything the part creates."""
        self.subscriber = client.create_subscriber(self.participant)
        topic = client.create_topic(self.participant, pnp_messages.PROFILE_TOPIC, pnp_messages.PROFILE_TYPE)
        self._profile_reader = client.create_reader(self.subscriber, topic)
        self._requester = client.create_requester(self.participant, INVENTORY)
        self._read_profile(JoinState.LOOKING)
        client.read(self._requester)

    def start(self) -> None:
        """Begin; must be called in the loop's thread."""
        self._turn.start(asyncio.get_running_loop())

    def end(self, reason: str) -> None:
        """The part ends."""
        if self._leaving is not None:
            self._leaving.cancel()
        self.joining.end(reason, self._turn.now())
        self._drain()
        self._turn.cancel()

    def leave(self, reason: str) -> None:
        """The part ends, and its session with it, as soon as the robot has heard what `say_trouble` said."""
        self._end_reason = reason
        if not self._unsaid:
            self._go()
        elif self._leaving is None:
            self._leaving = asyncio.get_running_loop().call_later(TELL_S, self._go)

    @property
    def has_trouble(self) -> bool:
        """Whether it has said in this session that something is wrong with its hardware."""
        return self._has_trouble

    @property
    def trouble_heard(self) -> bool:
        """After the end: whether the robot has heard what `say_trouble` said."""
        return self._has_trouble and not self._unsaid and self.client.was_heard

    def beat_soon(self) -> None:
        """Send a beat at once: the master waits for a sign that STOP has arrived."""
        self.joining.beat_soon(self._turn.now())
        self._drain()

    def _sample_received(self, object_id: int, request_id: int, payload: bytes) -> None:
        opened = self.seals.open(object_id, payload)
        if opened is None:
            return
        # Thesis 4.3.1: the object id must be that of the profile's reader.
        if object_id != self._profile_reader.object_id:
            self._on_topic(object_id, request_id, opened)
            return
        try:
            profile = pnp_messages.ProfileMessage.decode(opened)
        except RemoteProtocolError as error:
            self._drop("profile", error)
            return
        # The thesis defines the fields by their position (3.12.1).
        robot = ExpectedRobot(profile.message, profile.name, profile.id, profile.make)
        self.joining.profile_seen(robot, self._turn.now())
        self._drain()

    def _client_changed(self, state: ConnectionState, reason: str) -> None:
        now = self._turn.now()
        if state is ConnectionState.CONNECTED:
            self.joining.session_opened(now)
        elif state is ConnectionState.CLOSED:
            self.joining.end("ended", now)
        else:
            self.seals.session_lost()
            self._read_replies(STREAM_RELIABLE)
            self.joining.agent_lost(reason, now)
            self._forget_trouble()
        self._drain()

    def _reply_received(self, object_id: int, request_id: int, payload: bytes) -> None:
        now = self._turn.now()
        if self._thesis_requester is not None and object_id == self._thesis_requester.object_id:
            if len(payload) == thesis_messages.BUFFER_BYTES:
                self.joining.thesis_master_found(thesis_messages.DOES_NOT_JOIN, now)
                self._drain()
            return
        if object_id != self._requester.object_id:
            self._on_reply(object_id, request_id, payload)
            return
        opened = self.seals.open_reply(payload)
        if opened is None:
            return
        try:
            reply = pnp_messages.decode_reply(opened)
        except RemoteProtocolError as error:
            self._drop("reply of the inventory", error)
            return
        match reply:
            case pnp_messages.BeatReply():
                self.joining.beat_answered(reply.configuration_version, now)
            case pnp_messages.VerdictMessage():
                period_s = max(reply.beat_period_ms, SHORTEST_BEAT_MS) / 1000
                self.joining.verdict_given(reply.lease, period_s, _refusal_words(reply.reason), now)
            case pnp_messages.Challenge():
                self.joining.challenged(reply.nonce, now)
            case pnp_messages.SealedChallenge():
                self.joining.challenged(reply.nonce, now, sealed=True)
            case pnp_messages.Notice(kind=pnp_messages.NoticeKind.DESCRIBE):
                self._describe()
            case pnp_messages.Notice():
                self._noticed(reply)
            case pnp_messages.ConfigurationMessage():
                self._configuration_received(reply, now)
        self._drain()

    def _configuration_received(self, configuration: pnp_messages.ConfigurationMessage, now: float) -> None:
        if self.joining.state in (JoinState.CLAIMING, JoinState.REFUSED):
            self._help_received(configuration.settings)
            return
        if self.joining.configuration_received(configuration.version, configuration.slot, now):
            self._configure(configuration)
        if self.joining.state is JoinState.ACTIVE:
            self._read_replies(STREAM_BEST_EFFORT)

    def _help_received(self, settings: Sequence[pnp_messages.Setting]) -> None:
        """The robot says why it does not let the part in, and what helps."""
        told = next((one.value for one in settings if one.name == pnp_messages.HELP_SETTING), "")
        if told and told != self._help:
            self._help = told
            _log.info("the robot says: %s", printable(told))

    def _work(self, now: float) -> None:
        self.joining.handle_timer(now)
        self._drain()

    def _drain(self) -> None:
        while (action := self.joining.next_action()) is not None:
            match action:
                case Changed():
                    self._read_profile(action.after)
                    if action.after is not JoinState.CLAIMING and self._thesis_requester is not None:
                        self.client.delete(self._thesis_requester)
                        self._thesis_requester = None
                    self._changed(action)
                    if action.after is JoinState.ACTIVE and self._nature is not pnp_messages.Nature.UNKNOWN:
                        self._say_nature()
                    if action.after is JoinState.ACTIVE:
                        self._say_versions()
                case SendClaim():
                    self._send(self._claim, STREAM_RELIABLE)
                case AskThesisMaster():
                    self._ask_thesis_master()
                case SendProof():
                    self._send_proof(action)
                case SendBeat():
                    self._send_beat(action.lease)
                case FetchConfiguration() if self._absent:
                    self._say_absence()
                case FetchConfiguration():
                    self._read_replies(STREAM_RELIABLE)
                    request = pnp_messages.ConfigurationRequest(lease=action.lease, have_version=action.have_version)
                    self._send(request.encode(), STREAM_RELIABLE)
                case CheckAgent():
                    self.client.check_agent()
                case BeginAnew():
                    self.client.reconnect(action.reason)
        self._turn.set_timer(self.joining.timer())

    def _ask_thesis_master(self) -> None:
        if self._question is None:
            return
        if self._thesis_requester is None:
            self._thesis_requester = self.client.create_requester(self.participant, THESIS_INVENTORY)
            self.client.read(self._thesis_requester)
        try:
            self.client.write(self._thesis_requester, self._question, stream_id=STREAM_RELIABLE)
        except (LinkFull, LocalProtocolError) as error:
            _log.debug("the thesis' master is not asked for: %s", error)

    def _say_nature(self) -> None:
        message = pnp_messages.NatureMessage(lease=self.joining.lease, nature=self._nature)
        self._send(message.encode(), STREAM_RELIABLE)

    def _say_versions(self) -> None:
        for of, text in self._versions.items():
            self.log.add_version(of, text)
        self._say_on()

    def _describe(self) -> None:
        """The robot asks what the part is: it has not been let in, or a person adopts it anew. It may ask again."""
        is_outside = self.joining.state in (JoinState.CLAIMING, JoinState.REFUSED)
        if self._description and (is_outside or self.joining.lease):
            if is_outside:
                _log.info("%s", IS_TOLD)
            self._send(pnp_messages.DescriptionMessage(text=self._description).encode(), STREAM_RELIABLE)

    def say_type(self, binding: int, octets: bytes) -> None:
        """Tell the robot the hash of the messages that the program has at a port."""
        message = pnp_messages.TypeMessage(lease=self.joining.lease, binding=binding, hash=octets)
        self._send(message.encode(), STREAM_RELIABLE)

    def say_fields(self, text: str) -> None:
        """Tell the robot the fields of the program's messages, because a hash differs from the library's."""
        filled = text + "\n" * (pnp_messages.LEAST_DESCRIPTION - len(text.encode()))
        self._send(pnp_messages.DescriptionMessage(text=filled).encode(), STREAM_RELIABLE)

    def say_trouble(self, sentence: str) -> None:
        """Tell the robot what is wrong with the part's hardware; only a part that has a lease can."""
        if self.joining.lease:
            self._unsaid = [piece.encode() for piece in trouble_pieces(self.joining.lease, sentence)]
            self._has_trouble = bool(self._unsaid)
            self._say_on()

    def say_log(self, level: LogLevel, line: str) -> None:
        """Send a line to the robot's log; only an active part can."""
        if self.joining.state is JoinState.ACTIVE and self._leaving is None:
            self.log.add(level, line, self._turn.now())
            self._say_on()

    def _say_on(self) -> None:
        while self._unsaid and self._send(self._unsaid[0], STREAM_RELIABLE):
            del self._unsaid[0]
        if not self._unsaid:  # not in the middle of a sentence: pieces have no name
            for piece in self.log.pieces(self.joining.lease):
                if not self._send(piece, STREAM_RELIABLE):
                    break
                self.log.sent()
        if self._leaving is not None and not self._unsaid:
            self._go()

    def _forget_trouble(self) -> None:
        """The session is gone, and with it what was said of the hardware."""
        self._unsaid.clear()
        self.log.forget()
        self._has_trouble = False
        if self._leaving is not None:
            self._go()

    def _say_absence(self) -> None:
        """Say why the part's hardware is not there, and end once the robot has heard it."""
        if not self._has_trouble:
            self.say_trouble(self._absent)
            self.leave("its hardware is not there")

    def _go(self) -> None:
        self.end(self._end_reason)
        self.client.close_soon(deliver_s=TELL_S if self._has_trouble else 0.0)

    def _send_beat(self, lease: int) -> None:
        said = [pnp_messages.StoppedBeat(lease=lease, number=number & 0xFFFF) for number in self._stop_in_beats()]
        for beat in said or (pnp_messages.Beat(lease=lease),):
            self._send(beat.encode(), STREAM_BEST_EFFORT)

    def _send(self, request: bytes, stream_id: int) -> bool:
        try:
            self.client.write(self._requester, self.seals.seal_request(request), stream_id=stream_id)
        except (LinkFull, LocalProtocolError) as error:
            # No room, or the session is closing: `joining` asks again in time.
            _log.debug("not sent to the inventory: %s", error)
            return False
        return True

    def _read_profile(self, state: JoinState) -> None:
        reading = self._profile_reader.reading
        running = None if reading is None else reading.control
        wanted = self._profile_control(state, running)
        if reading is None or wanted != running:
            self.client.read(self._profile_reader, control=wanted)

    def _profile_control(self, state: JoinState, running: DeliveryControl | None) -> DeliveryControl | None:
        """How the profile is to be read from that state on."""
        if not self._profile_once or state is JoinState.WRONG_ROBOT:
            return ENDLESS
        if state in (JoinState.LOOKING, JoinState.LOST):
            return ONE_SAMPLE
        # Step 1 is done, but only after a profile that did not match is there a running read to end.
        return NO_MORE if state is JoinState.CLAIMING and running == ENDLESS else running

    def _send_proof(self, challenge: SendProof) -> None:
        answer: pnp_messages.Proof | pnp_messages.SealedProof
        if challenge.sealed and (sealed := self._prove_sealed(challenge.nonce)) is not None:
            proof, secret = sealed
            self.seals.proved(secret)
            answer = pnp_messages.SealedProof(proof=proof)
        elif not challenge.sealed and (plain := self._prove(challenge.nonce)) is not None:
            answer = pnp_messages.Proof(proof=plain)
        else:
            words = f"{Refusal.KEY_NEEDED.describe}: give it its key with --key or ${KEY_VARIABLE}"
            self.joining.verdict_given(0, 0.0, words, self._turn.now())
            return
        self._send(answer.encode(), STREAM_RELIABLE)

    def _read_replies(self, stream_id: int) -> None:
        reading = self._requester.reading
        if reading is None or reading.stream_id != stream_id:
            self.client.read(self._requester, stream_id=stream_id)

    def _drop(self, what: str, error: RemoteProtocolError) -> None:
        self.dropped += 1
        _log.debug("dropped a %s: %s", what, error)


def _refusal_words(code: int) -> str:
    try:
        return Refusal(code).describe
    except ValueError:
        return f"refused for reason {code}, which this version does not know"
