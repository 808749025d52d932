"""How a part joins its robot: two steps, then beats (docs/explain/plug_and_play.md).

The part reveals nothing about itself before the robot's profile matches (step 1). Then it claims its place until it
gets an answer (step 2), fetches its configuration and beats. Messages of the inventory are recognised by their length.
"""

import random
import struct

from micropython import const

from .cdr import Reader
from .errors import RemoteProtocolError
from .running import load, once
from .xrce import BEST_EFFORT, ENDLESS, RELIABLE, Client


class State:
    """One of a few states; `value` is the word that a person reads."""

    def __init__(self, value):
        self.value = value


class JoinState:
    """The states of a part."""

    LOOKING = State("looking")
    RECOGNISING = State("recognising")
    CLAIMING = State("claiming")
    CONFIGURING = State("configuring")
    ACTIVE = State("active")
    LOST = State("lost")
    REFUSED = State("refused")
    WRONG_ROBOT = State("wrong robot")
    ENDED = State("ended")


_S = JoinState
_CLAIMS = (_S.CLAIMING, _S.REFUSED)
_BEATS = (_S.CONFIGURING, _S.ACTIVE)
_AFTER_PROFILE = (_S.RECOGNISING, _S.CLAIMING, _S.REFUSED, _S.CONFIGURING, _S.ACTIVE)

_PROFILE_READER = const(0x0016)
_REQUESTER = const(0x0017)

_REFUSED_RETRY = const(2000)
_SHORTEST_BEAT = const(20)
_DESCRIBE = const(6)
_TYPE_DIFFERS = const(7)


class ExpectedRobot:
    """The robot that a part is made for; `*` in a field = any."""

    def __init__(self, name="*", version="*", serial_number="*", manufacturer="*"):
        self.fields = (name, version, serial_number, manufacturer)

    def disagreement(self, seen):
        """Why a robot with these fields is not this one, in words; None when it is."""
        for word, mine, theirs in zip(("name", "version", "serial number", "manufacturer"), self.fields, seen):
            if mine not in ("*", theirs):
                return once("words").disagreement(word, theirs, mine)
        return None


class Membership:
    """One part's membership in one robot, over one client; calls the part's `changed`, `configure`, `noticed`."""

    def __init__(self, part, link):
        client = Client(link, random.getrandbits(32) or 1, self)
        self.part = part
        self.state = _S.LOOKING
        self.reason = "looking for an agent"
        self.dropped = 0
        self.version = 0
        self.client = client
        self._shared = link.shared
        # Between claims, for the answer to a beat, beats without any answer (docs/reference/part.md).
        self._retry, self._patience, self._silent = (2000, 1000, 12.0) if self._shared else (500, 500, 3.5)
        self._lease = 0
        self._period = 1000
        self._retry_at = self._beat_at = self._waiting_since = None
        self._heard_at = 0
        self.robot = None  # the one that was recognised: four texts of its profile
        self._seals = None  # unless a robot asks for them
        self.description = ""  # what the part says of itself to a robot that asks
        self._nonce = random.getrandbits(32)
        objects = once("objects")
        self._claim = objects.claim(part, self._nonce)
        objects.create(client, self._shared)

    # Events.

    def connected(self, now):
        """A session is open."""
        if self.state in (_S.LOOKING, _S.LOST):
            self._change(_S.RECOGNISING, "agent found, waiting for the robot's profile", now)

    def lost(self, reason, now):
        """There is no session any more; forget what was agreed in it."""
        self._read_replies(RELIABLE)
        if self._seals:
            self._seals.session_lost()
        if self.state in (_S.LOOKING, _S.LOST):
            self.reason = reason
        elif self.state is not _S.ENDED:
            self._change(_S.LOST, reason, now)

    def topic_received(self, object_id, octets, now):
        """Take a sample: the robot's profile, or one for a port."""
        if self._seals:
            octets = self._seals.open(object_id, octets)
            if octets is None:
                self.part.counters.refused += 1
                return
        if object_id != _PROFILE_READER:
            self.part.sample_received(object_id, octets, now)
            return
        reader = Reader(octets)
        try:
            reader.number("I")
            seen = [reader.text() for _ in range(5)]
        except RemoteProtocolError:
            self.dropped += 1
            return
        # By position: name, version, serial number, release date, manufacturer (thesis 3.12.1).
        seen = (seen[0], seen[1], seen[2], seen[4])
        wrong = self.part.robot.disagreement(seen)
        if wrong and self.state in _AFTER_PROFILE:
            self._change(_S.WRONG_ROBOT, wrong, now)
        elif not wrong and self.state in (_S.RECOGNISING, _S.WRONG_ROBOT):
            self.robot = seen
            self._change(_S.CLAIMING, "recognised robot " + seen[0], now)

    def reply_received(self, octets, now):
        """Take a message of the inventory."""
        if self._seals:
            octets = self._seals.open_reply(octets)
            if octets is None:
                self.part.counters.refused += 1
                return
        try:
            self._take_reply(octets, now)
        except RemoteProtocolError:
            self.dropped += 1

    def service_received(self, object_id, octets):
        """Take a request for a port that serves, or a reply to one that calls."""
        if self._seals:
            octets = self._seals.open(object_id, octets)
            if octets is None:
                self.part.counters.refused += 1
                return
        if self.part.services:
            self.part.services.received(object_id, octets)

    def _take_reply(self, octets, now):
        size = len(octets)
        if size == 4:
            self._beat_answered(struct.unpack("<I", octets)[0], now)
        elif size == 8:
            number, place, kind, detail = struct.unpack("<IHBB", octets)
            if kind == _DESCRIBE:
                once("versions").describe(self)
            elif kind == _TYPE_DIFFERS and number == self.version:
                once("type_hash").differs(self.part, place, detail)
            self.part.noticed(kind, number, place, now)
        elif size == 12:
            lease, _, period, reason, _ = struct.unpack("<IIHBB", octets)
            self._verdict(lease, period, reason, now)
        elif size == 16:
            self._challenged(octets, now)
        elif size == 17:
            self._challenged(octets[:16], now, True)
        else:
            self._configured(*once("configuring").read(octets), now)

    def closed(self, now):
        """The part ends; it never leaves this state."""
        if self.state is not _S.ENDED:
            self._change(_S.ENDED, "ended", now)

    # Actions.

    def seal(self, object_id, octets):
        """A sample for a port's data writer, sealed if this robot seals."""
        return self._seals.seal(object_id, octets) if self._seals else octets

    def _challenged(self, nonce, now, sealed=False):
        self._heard_at = now
        if self.state not in _CLAIMS:
            return
        if self.part.key is None:
            self._refused(once("words").key_needed(), now)
            return
        part = self.part
        claimed = (part.key, nonce, part.uid, part.part_number, part.local_name, self.client.key)
        if sealed:
            self._seals = self._seals or load("seal").Seals()
            proof = self._seals.prove(*claimed, self._nonce)
        else:
            proof = once("keys").prove(*claimed)
        self.client.write(_REQUESTER, proof, RELIABLE)
        self._retry_at = now + self._retry

    def _verdict(self, lease, period, reason, now):
        self._heard_at = now
        if lease and self.state in _CLAIMS + _BEATS:
            moved = self.state is _S.ACTIVE and lease != self._lease
            self._lease = lease
            self._period = max(period, _SHORTEST_BEAT)
            if self.state in _CLAIMS:  # otherwise the claim was repeated on a slow bus
                self._change(_S.CONFIGURING, "registered, fetching the configuration", now)
            elif moved:
                self.version = 0  # two slots may have the same version
                self._fetch(now)
        elif not lease:
            self._refused(once("words").refusal(reason), now)

    def _refused(self, words, now):
        if self.state is _S.CLAIMING:
            self._change(_S.REFUSED, words, now)
        if self.state is _S.REFUSED:
            self.reason = words
            self._retry_at = now + _REFUSED_RETRY

    def _configured(self, version, slot, bindings, settings, now):
        if self.state not in _BEATS:
            return
        self._heard_at = now
        news = self.state is _S.CONFIGURING or version != self.version
        self.version = version
        if self.state is _S.ACTIVE:
            self._retry_at = None
        if news:
            self.part.configure(slot, bindings, settings, now)
        if self.state is _S.CONFIGURING:
            self._change(_S.ACTIVE, "in slot " + slot, now)
        if self.state is _S.ACTIVE:
            self._read_replies(BEST_EFFORT)  # a late answer to a beat is worthless

    def _beat_answered(self, version, now):
        if self.state not in _BEATS:
            return
        self._waiting_since = None
        self._heard_at = now
        if version == 0:
            self._change(_S.CLAIMING, "the inventory does not know this part any more", now)
            return
        self.part.counters.beats += 1
        if self.state is _S.ACTIVE and version != self.version and self._retry_at is None:
            self._fetch(now)

    def beat_soon(self, now):
        """Beat at once: the master waits for a sign."""
        if self.state in _BEATS:
            self._beat(now)

    def step(self, now):
        """Claim, fetch, beat, notice a missed beat."""
        if self._retry_at is not None and now >= self._retry_at:
            if self.state in _CLAIMS:
                self._send_claim(now)
            else:
                self._fetch(now)
        if self._waiting_since is not None and now >= self._waiting_since + self._patience:
            self._beat_missed(now)
        if self._beat_at is not None and now >= self._beat_at:
            self._beat_at = max(self._beat_at + self._period, now + 1)
            self._beat(now)

    def due(self):
        """When `step` must be called: times, or None."""
        return self._retry_at, self._beat_at, self._waiting_since and self._waiting_since + self._patience

    def _change(self, state, reason, now):
        before, self.state, self.reason = self.state, state, reason
        self._retry_at = None
        if state not in _BEATS:
            self._lease = self.version = 0
            self._beat_at = self._waiting_since = None
        self._read_profile()
        self.part.changed(before, state, reason, now)
        if self.state is not state:
            return  # a function of the part has ended it
        if state is _S.ACTIVE:
            once("versions").tell(self, now)
        elif state is _S.CLAIMING:
            self._send_claim(now)
        elif state is _S.REFUSED:
            self._retry_at = now + _REFUSED_RETRY
        elif state is _S.CONFIGURING:
            self._beat_at = now + self._period
            self._fetch(now)

    def _send_claim(self, now):
        self.client.write(_REQUESTER, self._claim, RELIABLE)
        self._retry_at = now + (self._retry if self.state is _S.CLAIMING else _REFUSED_RETRY)

    def _fetch(self, now):
        self._read_replies(RELIABLE)
        self._ask(struct.pack("<II", self._lease, self.version), RELIABLE)
        self._retry_at = now + self._retry

    def _beat(self, now):
        for number in self.part.stop_in_beats() or (None,):
            beat = struct.pack("<IH", self._lease, (number or 0) & 0xFFFF)
            self._ask(beat[:4] if number is None else beat, BEST_EFFORT)
        if self._waiting_since is None:
            self._waiting_since = now

    def _ask(self, request, stream):
        return self.client.write(_REQUESTER, self._seals.seal_request(request) if self._seals else request, stream)

    def _beat_missed(self, now):
        self.part.counters.missed_beats += 1
        self._waiting_since = None
        if now - self._heard_at >= self._silent * self._period:
            # The agent may well be there: a session whose streams are out of step looks the same from here.
            self.client.lose("the inventory has not answered any beat lately", now)
            return
        self.client.check(now)
        self._beat(now)

    def _read_replies(self, stream):
        if self.client.find(_REQUESTER).reading[0] != stream:
            self.client.read(_REQUESTER, stream)

    def _read_profile(self):
        """Read the profile; on a shared bus only once: repetitions would cost the others time, and the beacon announces
        changes."""
        running = self.client.find(_PROFILE_READER).reading[1]
        wanted = running
        if not self._shared or self.state is _S.WRONG_ROBOT:
            wanted = ENDLESS
        elif self.state in (_S.LOOKING, _S.LOST):
            wanted = None
        elif self.state is _S.CLAIMING and running == ENDLESS:
            wanted = 0
        if wanted != running:
            self.client.read(_PROFILE_READER, RELIABLE, wanted)
