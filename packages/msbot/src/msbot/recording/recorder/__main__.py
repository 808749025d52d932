"""The recorder's process: records come in on standard input, what people should know goes out as lines of JSON.

`python -m msbot.recording.recorder FOLDER SECONDS OCTETS`; an empty FOLDER: no ring. It ends when its input ends, that
is when the robot is gone, however that came about.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import signal
import sys
import threading
import time
from pathlib import Path
from typing import Final

from msbot.recording.recorder.batch import Unpacker
from msbot.recording.recorder.recording_file import RingLimits
from msbot.recording.recorder.ring_storage import Storing

FLUSH_S: Final = 0.5
PIECE: Final = 1 << 18
MOST_PIECES: Final = 16


def _read(pieces: queue.Queue[bytes]) -> None:
    while piece := os.read(0, PIECE):
        pieces.put(piece)
    pieces.put(b"")


def _say(file: str, **news: object) -> None:
    with contextlib.suppress(BrokenPipeError):  # the robot is gone; its last records are still written
        os.write(1, json.dumps({"file": file, **news}).encode() + b"\n")


def main() -> None:
    """Write what comes until nothing comes any more."""
    # Ctrl-C and the end of a service reach all processes; this one outlives the robot to write its last records.
    for number in (signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if hasattr(signal, "SIGHUP") else [])):
        signal.signal(number, signal.SIG_IGN)
    if hasattr(os, "nice"):
        os.nice(5)
    folder, seconds, octets = sys.argv[1:]
    storing = Storing(
        Path(folder) if folder else None,
        RingLimits(float(seconds), int(octets)),
        lambda file, trouble: _say(file, trouble=trouble),
        on_left_out=lambda file, topics: _say(file, left_out=topics),
        on_end=lambda file: _say(file, has_ended=True),
    )
    pieces: queue.Queue[bytes] = queue.Queue(MOST_PIECES)
    threading.Thread(target=_read, args=(pieces,), daemon=True, name="msbot-recorder-input").start()
    unpacker = Unpacker()
    flush_at = time.monotonic() + FLUSH_S
    while True:
        try:
            piece: bytes | None = pieces.get(timeout=max(0.0, flush_at - time.monotonic()))
        except queue.Empty:
            piece = None
        if piece == b"":
            break
        now = time.monotonic()
        if piece:
            for item in unpacker.feed(piece):
                storing.take(item, now)
        if now >= flush_at:
            storing.flush(now)
            flush_at = now + FLUSH_S
    storing.close()


if __name__ == "__main__":
    main()
