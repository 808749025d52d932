"""One line or one CAN controller for several parts: a branch each, which looks like the line or controller itself."""

from micropython import const

_KEPT = const(1024)  # octets that may wait for a part; beyond, the oldest are dropped, and their frame comes again
_FRAMES = const(64)
_DOWN = const(0x180)
_NODES = const(0x7F)


class _StreamBranch:
    """A byte stream (`read`, `write`)."""

    def __init__(self, trunk):
        self.trunk = trunk
        self.came = b""

    def read(self):
        self.trunk.fetch()
        octets, self.came = self.came, b""
        return octets

    def write(self, octets):
        return self.trunk.write(self, octets)

    def close(self):
        self.trunk.forget(self)


class StreamTrunk:
    """A byte stream that all read, and on which one frame is written at a time."""

    Branch = _StreamBranch

    def __init__(self, stream):
        self._stream = stream
        self._branches = []
        self._writing = None  # the branch whose frame is only half written

    def branch(self):
        """One more of it."""
        made = _StreamBranch(self)
        self._branches.append(made)
        return made

    def fetch(self):
        """Hand out what came."""
        octets = self._stream.read()
        if octets:
            for branch in self._branches:
                branch.came = (branch.came + octets)[-_KEPT:]

    def write(self, branch, octets):
        """Write some octets of a branch; returns how many."""
        if self._writing not in (None, branch):
            return 0
        size = self._stream.write(octets) or 0
        self._writing = None if size >= len(octets) else branch
        return size

    def forget(self, branch):
        """Its part has ended; the rest of a half written frame is not missed: the other end waits for the next."""
        self._branches.remove(branch)
        if self._writing is branch:
            self._writing = None


class _BusBranch:
    """A controller (`recv`, `send`, `pending`, `listen`)."""

    def __init__(self, trunk):
        self.trunk = trunk
        self.node = 0
        self.came = []

    def recv(self):
        if not self.came:
            self.trunk.fetch()
        return self.came.pop(0) if self.came else None

    def send(self, identifier, extended, data):
        return self.trunk.bus.send(identifier, extended, data)

    def pending(self):
        return self.trunk.bus.pending()

    def listen(self, node):
        self.node = node
        self.trunk.listen()

    def close(self):
        self.trunk.forget(self)


class BusTrunk:
    """A CAN controller; each branch has an address of its own on the bus."""

    Branch = _BusBranch

    def __init__(self, bus):
        self.bus = bus
        self._branches = []

    def branch(self):
        """One more of it."""
        made = _BusBranch(self)
        self._branches.append(made)
        return made

    def fetch(self):
        """Hand out what came: packets to the address that they are for, all else to everybody."""
        for _ in range(_FRAMES):
            frame = self.bus.recv()
            if frame is None:
                return
            node = frame[0] - _DOWN
            to_one = not frame[1] and 0 < node <= _NODES
            for branch in self._branches:
                if (not to_one or branch.node == node) and len(branch.came) < _FRAMES:
                    branch.came.append(frame)

    def listen(self):
        """Set the filters for all addresses."""
        nodes = [branch.node for branch in self._branches if branch.node]
        self.bus.listen(*(nodes or [0]))

    def forget(self, branch):
        """Its part has ended."""
        self._branches.remove(branch)
