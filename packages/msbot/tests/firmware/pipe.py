"""The firmware in a process of its own, compiled with the sanitizers, and called through a pipe."""

from __future__ import annotations

import struct
import subprocess
from dataclasses import dataclass
from pathlib import Path

from tests.firmware.msbot_side import DROP_REASONS, Frame

EXTENDED, FD, BRS, REMOTE = 1, 2, 4, 8
_LENGTH = struct.Struct("<H")
_STATE = struct.Struct("<BBBBBBBI")
BATCH = 200
"""Requests on the way at a time: more could fill both pipes."""


@dataclass(frozen=True)
class LinkState:
    """What the link tells about itself."""

    events: int
    reason: int
    node_id: int
    use: int
    state: int
    stop_reason: int
    due_us: int | None


class Firmware:
    """Calls the functions of `host/pipe.c`."""

    def __init__(self, program: Path) -> None:
        self._process = subprocess.Popen([program], stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    def close(self) -> None:
        """End it, and see that it ended well: the sanitizers look at leaks last."""
        self._process.communicate()
        assert self._process.returncode == 0, "a sanitizer found something: see above"

    def ask(self, *requests: bytes) -> list[bytes]:
        """The answers to some requests."""
        answers: list[bytes] = []
        for start in range(0, len(requests), BATCH):
            answers += self._ask(requests[start : start + BATCH])
        return answers

    def _ask(self, requests: tuple[bytes, ...]) -> list[bytes]:
        to, back = self._process.stdin, self._process.stdout
        assert to is not None
        assert back is not None
        to.write(b"".join(_LENGTH.pack(len(request)) + request for request in (*requests, b".")))
        to.flush()
        answers = []
        for _ in requests:
            length = back.read(2)
            assert len(length) == 2, "the firmware has ended: a sanitizer says why above"
            answers.append(back.read(_LENGTH.unpack(length)[0]))
        return answers

    # Pieces.

    def join(self, frames: list[tuple[int, bytes]], *, limit: int, repeat: int) -> tuple[list[bytes], dict[str, int]]:
        """The messages in some (time in us, data), and what was dropped."""
        begin = b"J" + struct.pack("<HH", limit, repeat)
        answers = self.ask(begin, *(b"j" + struct.pack("<I", at) + data for at, data in frames), b"d")
        return answers[1:-1], _drops(answers[-1])

    def split(self, packet: bytes, q: int, *, fd: bool) -> list[bytes]:
        """The data of the packet's frames."""
        (answer,) = self.ask(b"S" + bytes((fd, q)) + packet)
        frames = []
        while answer:
            frames.append(answer[1 : answer[0] + 1])
            answer = answer[answer[0] + 1 :]
        return frames

    def compress(self, packet: bytes) -> bytes:
        """A short form."""
        return self.ask(b"C" + packet)[0]

    def decompress(self, form: bytes, room: int = 1024) -> bytes | None:
        """The packet of a short form; None when it is none."""
        (answer,) = self.ask(b"D" + _LENGTH.pack(room) + form)
        return answer[1:] if answer[0] else None

    # The link.

    def make_link(
        self,
        uid: bytes,
        *,
        codec: bool = False,
        fd: bool = False,
        fast: bool = False,
        robot: int | None = None,
        bitrate: int = 0,
        seed: int = 0,
    ) -> None:
        """A fresh link, off the bus."""
        self.ask(b"l" + uid + struct.pack("<????III", codec, fd, fast, robot is not None, robot or 0, bitrate, seed))

    def state(self) -> LinkState:
        """How the link stands; takes its events."""
        (answer,) = self.ask(b"e")
        events, reason, node_id, use, state, stop_reason, has_due, due = _STATE.unpack(answer)
        return LinkState(events, reason, node_id, use, state, stop_reason, due if has_due else None)

    def next_frame(self, pending: int = 0) -> Frame | None:
        """The next frame for the controller."""
        (answer,) = self.ask(b"n" + bytes((pending,)))
        return frame_of(answer) if answer else None

    def link_drops(self) -> dict[str, int]:
        """What the link has dropped."""
        return _drops(self.ask(b"x")[0])


def frame_octets(frame: Frame) -> bytes:
    """A frame as the firmware's pipe takes it."""
    flags = EXTENDED * frame.extended | FD * frame.fd | BRS * frame.brs | REMOTE * frame.remote
    return struct.pack("<IB", frame.can_id, flags) + frame.data


def frame_of(octets: bytes) -> Frame:
    """And back."""
    can_id, flags = struct.unpack_from("<IB", octets)
    return Frame(can_id, octets[5:], bool(flags & EXTENDED), bool(flags & FD), bool(flags & BRS), bool(flags & REMOTE))


def _drops(answer: bytes) -> dict[str, int]:
    counts = struct.unpack(f"<{len(answer) // 2}H", answer)
    reasons = (*DROP_REASONS, "not compressed")
    return {reason: number for reason, number in zip(reasons, counts, strict=True) if number}
