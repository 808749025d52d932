"""What went wrong in a program, in one sentence, from the traceback that MicroPython prints."""

from __future__ import annotations

import re

_FRAME = re.compile(r'^ *File "(?P<file>[^"]+)", line (?P<line>\d+)', re.MULTILINE)


def error_sentence(traceback: str, program: str) -> str:
    """`my_part.py, line 7: NameError: name 'x' isn't defined`; "" for a program that was interrupted.

    Args:
        traceback: as the board prints it.
        program: the file whose line a person wants to see; if no frame is in it, the innermost one is named.
    """
    lines = [line for line in traceback.replace("\r", "").split("\n") if line.strip()]
    what = lines[-1].strip() if lines else ""
    if what.partition(":")[0] == "KeyboardInterrupt":
        return ""
    frames = list(_FRAME.finditer(traceback))
    mine = [frame for frame in frames if frame["file"] == program] or frames
    return f"{mine[-1]['file']}, line {mine[-1]['line']}: {what}" if mine else f"{program}: {what or 'no reason given'}"
