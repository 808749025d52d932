"""A generic board: flashed once, it becomes up to eight parts that its robot names (docs/howto/generic_board.md).

The board joins as a part of a type such as BOARD-8. Its configuration has a document for each part that is wired to it
(settings `.part.1` and so on); each becomes a part of its own with a UID and a session of its own, over the same link.
The documents are kept in a file: after a power cut the board drives its outputs to their safe values before it speaks
to anybody.
"""

import gc
import hashlib
import json
import os
import struct
import time
from binascii import crc32

from micropython import const

from .driver import Fault
from .errors import MsbotError, say
from .membership import JoinState
from .message import Message, limits
from .running import once
from .model import Model, number
from .part import Part
from .xrce import RELIABLE

FILE = "parts.json"
_NEW = FILE + ".new"
MARK = ".part."
_MOST = const(8)
_TICK = 20  # ms
_SLOW_TICK = 100
_ALIVE = 1000  # ms: even a part that speaks only on a change is read that often
_FAULTS = const(3)  # readings in a row that may fail: noise on a wire does not mean that the chip is missing
_TELL = const(3000)  # ms: longest time that a part stays for the robot to hear why it ends
_RETRY = const(1000)  # ms between two attempts to open a driver
_UINT32 = const(0xFFFFFFFF)


def run_board(part_number="BOARD-8", local_name=None):
    """Run the board until Ctrl-C; the whole of a `main.py`."""
    from .board import open_for
    from .running import Clock

    board = GenericBoard(Part(part_number, local_name=local_name))
    try:
        link = open_for(board.part)
    except MsbotError as error:
        say("error", str(error))
        return
    clock = Clock()
    board.begin(link, clock.now())
    due = 0
    while due is not None:
        try:
            while due is not None:  # inside: MicroPython may raise it where a loop begins again
                due = board.step(clock.now())
                if due is not None:
                    time.sleep_ms(max(0, min(due - clock.now(), 1)))
        except KeyboardInterrupt:
            board.end()


class GenericBoard:
    """The board's own part, and those that are wired to it."""

    def __init__(self, part):
        self.part = part
        part.nature = 1
        self.units = []
        self._seen = None
        self._reported = None
        self._link = None
        self._ending = False
        part.every(1.0)(self._report)

    def begin(self, link, now):
        """Take up what was kept, with safe outputs, and begin to join."""
        self._link = link
        self.wire(read_kept(), now)
        self.part.begin(link, now)

    def step(self, now):
        """Do what is due; returns when to call it again, None = the board has ended."""
        dues = [unit.step(now) for unit in self.units]
        due = self.part.step(now)
        dues = [one for one in dues if one is not None]
        if due is None and not dues:
            return None
        settings = self.part.settings
        if settings is not self._seen and self.part.state is JoinState.ACTIVE:
            self._seen = settings
            self._configured(settings, now)
        return min(dues + [due]) if due is not None else min(dues)

    def end(self):
        """End all parts politely."""
        self._ending = True
        for unit in self.units:
            unit.end()
        self.part.end()

    def wire(self, texts, now):
        """Be the parts of these documents; those that have not changed go on."""
        for unit in self.units:
            if unit.text not in texts:
                unit.end()
        self.units = [unit for unit in self.units if not unit.is_over()]
        have = [unit.text for unit in self.units]
        for text in texts:
            if text not in have and len(self.units) < 2 * _MOST:
                self._add(text, now)
        gc.collect()

    def _configured(self, settings, now):
        names = sorted([name for name in settings if name.startswith(MARK)])
        texts = [settings[name] for name in names[:_MOST]]
        if sorted(texts) != sorted([unit.text for unit in self.units if not unit.ending]):
            keep(texts)
            self.wire(texts, now)

    def _add(self, text, now):
        taken = [unit.place for unit in self.units]
        place = min([one for one in range(1, 2 * _MOST + 1) if one not in taken])
        try:
            document = json.loads(text)
            uid = hashlib.sha256(self.part.uid + (document["number"] + "\0" + document["name"]).encode()).digest()[:8]
            unit = Unit(text, document, uid, self.part.key, lambda: self._link.branch(place))
            unit.clock = self.part.clock
        except (ValueError, KeyError, TypeError, AttributeError, ImportError) as error:
            say(
                "error", "the master's word about a part cannot be understood: {!r}; is MsBOT here older?".format(error)
            )
            return
        unit.place = place
        self.units.append(unit)
        unit.step(now)

    def _report(self):
        """Tell the robot what is wrong, when that changes."""
        words = "; ".join(["{}: {}".format(unit.name, unit.fault) for unit in self.units if unit.fault])
        if words != self._reported and self.part.bound("report"):
            if self.part.publish("report", once("standards").standard("Text")(text=words)):
                self._reported = words


class Unit:
    """One part that is wired to the board: driver, model, and a part that joins while its hardware answers."""

    def __init__(self, text, document, uid, key, connect):
        self.text = text
        self.name = document["name"]
        self.fault = ""
        self.faults = 0
        self.part = None
        self.ending = False
        self.place = 0
        self.clock = None
        self._document = document
        self._uid = uid
        self._key = key
        self._connect = connect
        module = __import__(__name__.rpartition(".")[0] + "." + document["module"], None, None, ("",))
        self._driver = module.DRIVERS[document["driver"]](document)
        self._classes = {name: message_class(port) for name, port in document["ports"].items()}
        self.model = Model(document, self._fit)
        self._link = None
        self._given = None
        self._failed = 0
        self._retry_at = self._leave_at = None
        self._now = self._next = 0

    def is_over(self):
        """Whether it has ended."""
        return self.ending and self.part is None

    def end(self):
        """End it politely; outputs are off at once."""
        self.ending = True
        if self.part is not None:
            self.part.end()
        self._close()

    def step(self, now):
        """Do what is due; None = it is over."""
        self._now = now
        if self.part is not None:
            try:
                due = self.part.step(now)
            except MsbotError as error:  # a link that is gone
                self._trouble(str(error))
                due = None
            if self._leave_at is not None and (now >= self._leave_at or self.part._client.is_heard()):
                self._leave_at = None
                self.part.end()
            if due is not None:
                return due
            self.part = self._leave_at = None
            self._link.close()
            self._close()
            self._retry_at = now + _RETRY
        if self.ending:
            return None
        if self._retry_at is None or now >= self._retry_at:
            self._open(now)
        return self._retry_at if self.part is None else now

    # Opening and failing.

    def _open(self, now):
        self._retry_at = now + _RETRY
        try:
            self._driver.open()
            if self._driver.samples:
                self._feed(self._driver.sample(self.model.values))
        except (OSError, ValueError, Fault) as error:
            self._trouble(self._driver.words(error))
            self._close()
            return
        if self.fault:
            say("info", "{}: its hardware answers again".format(self.name))
        self.fault = ""
        self._failed = 0
        self._given = None
        self._be_safe()
        self.part = part = self._make_part()
        self._link = self._connect()
        part.begin(self._link, now)

    def _close(self):
        try:
            self._driver.close()
        except OSError:  # it is closed because it does not answer, which was said
            pass

    def _trouble(self, words):
        self.faults += 1
        if words != self.fault:
            self.fault = words
            say("error", "{}: {}".format(self.name, words))

    def _make_part(self):
        document = self._document
        part = Part(document["number"], local_name=self.name, uid=self._uid, key=self._key)
        part.clock = self.clock
        part.nature = 1
        for name, port in document["ports"].items():
            if port[0]:
                self._listen(part, name)
        moves = self._driver.drives or self._driver.poll
        tick = _TICK if moves else min(_SLOW_TICK, max(_TICK, self.model.period() or _SLOW_TICK))
        part.every(tick / 1000)(self._tick)
        part.on_join(self._joined)
        part.safe_state(self._be_safe)
        return part

    def _listen(self, part, name):
        def take(message):
            now = part._now
            self.model.settings(part.settings, now)
            fields = {field: getattr(message, field) for field, _ in self._classes[name]._fields}
            self.model.receive(name, fields, now)
            self.model.look()
            self._move()

        part.on(name, self._classes[name], optional=True)(take)

    # While it is in its robot.

    def _joined(self):
        self.model.settings(self.part.settings, self.part._now)
        self.model.begin(self.part._now)
        self._next = self.part._now

    def _tick(self):
        now = self.part._now
        self.model.settings(self.part.settings, now)
        if not self._driver.samples:
            self._say(now)
        elif now >= self._next:
            self._next = now + self._period()
            try:
                measured = self._driver.sample(self.model.values)
            except (OSError, Fault) as error:
                self._missed(error)
                return
            self._failed = 0
            if measured is not None:
                self._feed(measured)
                self._say(now)
        self.model.advance(now)
        self._move()

    def _missed(self, error):
        self._failed += 1
        if self._failed >= _FAULTS:
            words = self._driver.words(error)
            self._trouble(words)
            if self._leave_at is None:
                say_trouble(self.part._membership, words)
                self._leave_at = self.part._now + _TELL

    def _period(self):
        times = [one for one in (self.model.period(), self._driver.poll) if one]
        return max(_TICK, min(times)) if times else _ALIVE

    def _feed(self, measured):
        for values in measured if isinstance(measured, list) else (measured,):
            if values:
                self.model.feed(values, self._now)
                self.model.look()

    def _say(self, now):
        for port, fields in self.model.say(now):
            field = self._document.get("stops", {}).get(port)
            if field:
                self.part.hold_stop(bool(fields[field]))
            if self.part.bound(port):
                self.part.publish(port, self._classes[port](**fields))

    def _move(self):
        if self._driver.drives:
            wanted = self._driver.outputs_for(self.model.values)
            if wanted != self._given:
                self._driver.drive(wanted)
                self._given = wanted

    def _be_safe(self):
        """Nobody is in command: the configuration's safe values, else the type's, at once and without a ramp."""
        part = self.part
        if part is not None and part.state is JoinState.ACTIVE and not part.stopped:
            return  # only one port's partner is lost, which the part has dealt with
        for name, port in self._document["ports"].items():
            given = part and part._safe.get(name)
            if given:
                fields = {field: getattr(given, field) for field, _ in self._classes[name]._fields}
                self.model.receive(name, fields, self._now, False)
            elif len(port) > 3:
                self.model.receive(name, port[3], self._now, False)
        if self._driver.drives:
            self.model.settle(self._now)
            self._move()

    def _fit(self, port, field, value):
        """A value in the form that a message's field takes."""
        for name, kind in self._classes[port]._fields:
            if name == field:
                return fit(kind, value)
        raise ValueError(field)


def say_trouble(membership, sentence):
    """Tell the robot what is wrong before the part ends, in pieces of 12 octets; 15 at most. Here and not in
    `membership`: memory is scarce where nobody says it."""
    octets, lease = sentence.encode()[:180], membership._lease
    for at in range(0, len(octets) if lease else 0, 12):
        place = at // 12 | (0x80 if at + 12 >= len(octets) else 0)
        piece = octets[at : at + 12]
        membership._ask(struct.pack("<IB", lease, place) + piece + bytes(12 - len(piece)), RELIABLE)


def message_class(port):
    """The class of the messages of a port, `[comes in, type, fields]`."""
    _, type_name, coded = port[:3]
    known = once("standards").standard(type_name)
    if known is not None:
        return known
    kinds = [pair.split(":") for pair in coded.split(" ") if pair]
    kinds = [(name, {"s": str, "?": bool}.get(code, code)) for name, code in kinds]
    return type(type_name, (Message,), {"_fields": tuple(kinds)})


def fit(kind, value):
    """A value as one of that kind: rounded, limited, or as text."""
    if kind is bool:
        return bool(value)
    if kind is str:
        return str(value).replace("\0", "")
    value = number(value)
    if kind in "fd":
        return value
    low, high = limits(kind)
    return min(high, max(low, round(value)))


# What is kept: a line with a checksum, then a document a line.


def keep(texts):
    """Keep the documents; the old ones stay until the new ones are complete."""
    body = "\n".join(texts)
    with open(_NEW, "w") as file:
        file.write("{:08x}\n{}".format(crc32(body.encode()) & _UINT32, body))
    try:
        os.rename(_NEW, FILE)
    except OSError:  # FAT does not replace a file
        os.remove(FILE)
        os.rename(_NEW, FILE)


def read_kept():
    """The documents that were kept; none if there is no complete file."""
    for name in (FILE, _NEW):
        try:
            with open(name) as file:
                check, _, body = file.read().partition("\n")
        except OSError:
            continue
        if check == "{:08x}".format(crc32(body.encode()) & _UINT32):
            return [text for text in body.split("\n") if text]
        say("error", "{} is damaged, and not used: the master says again what is wired".format(name))
    return []
