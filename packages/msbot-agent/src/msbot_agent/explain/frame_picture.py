"""One CAN frame as an oscilloscope shows it: CAN-H and CAN-L, bit by bit, with fields and stuff bits named.

The bits are those of `msbot_agent.link.can.protocol.wire_bits`. The picture is the same every time, and reads well on
light and on dark pages.
"""

from __future__ import annotations

from html import escape
from itertools import accumulate

from msbot_agent.link.can.protocol import Frame, WireBit, format_frame, wire_bits
from msbot_xrce.lazy import dataclass

CELL = 22
"""Width of a bit."""
LEFT = 68
TOP = 84
ROW = 215
"""Height of a row."""
WIDTH = 820
ROW_BITS = (WIDTH - LEFT - 16) // CELL
HIGH, MIDDLE, LOW = 0, 34, 68
"""3.5 V, 2.5 V and 1.5 V below the upper end of a trace."""
LEVELS = ((HIGH, "3.5 V"), (MIDDLE, "2.5 V"), (LOW, "1.5 V"))

STYLE = """
text { font: 12.5px system-ui, "Segoe UI", Roboto, Helvetica, Arial, sans-serif; fill: #1f2933; }
.panel { fill: #ffffff; stroke: #d5dbe1; }
.scope { fill: #f6f8fa; stroke: #e1e6eb; }
.title { font-size: 20px; font-weight: 600; }
.soft { fill: #5b6773; }
.name { font-size: 12.5px; font-weight: 600; text-anchor: middle; }
.side { font-size: 11.5px; font-weight: 600; }
.mean { font-size: 12px; text-anchor: middle; }
.bit { font: 13.5px ui-monospace, SFMono-Regular, Menlo, Consolas, monospace; text-anchor: middle; }
.tick { font-size: 11px; text-anchor: middle; }
.volt { font-size: 11px; text-anchor: end; }
.grid { stroke: #dfe4ea; stroke-width: 1; }
.zero { stroke: #c3cbd4; stroke-width: 1; stroke-dasharray: 2 3; }
.tock { stroke: #8b96a2; stroke-width: 1; }
.h { stroke: #c2410c; fill: none; stroke-width: 2.2; stroke-linejoin: round; }
.l { stroke: #1d4ed8; fill: none; stroke-width: 2.2; stroke-linejoin: round; }
.h-text { fill: #c2410c; font-weight: 600; }
.l-text { fill: #1d4ed8; font-weight: 600; }
.stuff { fill: #a21caf; fill-opacity: 0.14; }
.others { fill: #f59e0b; fill-opacity: 0.22; }
.run { stroke: #a21caf; stroke-width: 1.6; fill: none; }
.stuff-text { fill: #a21caf; font-weight: 700; }
.start, .ends { fill: #d9dfe6; }
.who { fill: #c7dcf7; }
.control { fill: #bfe6df; }
.data { fill: #d7e8bd; }
.check { fill: #dccff2; }
.answer { fill: #fbd9a8; }
@media (prefers-color-scheme: dark) {
  text { fill: #e6ebf0; }
  .panel { fill: #11161d; stroke: #2c3641; }
  .scope { fill: #0b0f14; stroke: #232c36; }
  .soft { fill: #9aa7b4; }
  .grid { stroke: #1c242d; }
  .zero { stroke: #3b4652; }
  .h { stroke: #fb923c; }
  .l { stroke: #60a5fa; }
  .h-text { fill: #fb923c; }
  .l-text { fill: #60a5fa; }
  .stuff { fill: #e879f9; fill-opacity: 0.2; }
  .run { stroke: #e879f9; }
  .stuff-text { fill: #f0abfc; }
  .start, .ends { fill: #37424e; }
  .who { fill: #1f4471; }
  .control { fill: #12504a; }
  .data { fill: #3d5220; }
  .check { fill: #463275; }
  .answer { fill: #6f4512; }
}
"""


@dataclass(frozen=True)
class BitSpan:
    """Neighbouring bits that belong together."""

    name: str
    meaning: str
    kind: str
    """Class of its colour."""
    bits: list[WireBit]


_KINDS = {
    "SOF": "start", "ID": "who", "DATA": "data", "STUFF COUNT": "check", "CRC": "check", "CRC DELIMITER": "check",
    "ACK": "answer", "ACK DELIMITER": "ends", "EOF": "ends", "INTERMISSION": "ends",
}  # fmt: skip
"""By field: the class of its colour; the others control."""
_NAMES = {"CRC DELIMITER": "CRC end", "ACK DELIMITER": "ACK end", "INTERMISSION": "pause", "R0": "r0", "R1": "r1"}


def spans_of(frame: Frame) -> list[BitSpan]:
    """The fields of a frame, in order; the data in octets."""
    spans: list[BitSpan] = []
    for name, bits in _fields(wire_bits(frame)):
        if name == "DATA":
            octets = split_by_octets(bits, (1,) * len(frame.data))
            spans += [
                BitSpan(f"DATA {octet:02X}", "", "data", piece) for octet, piece in zip(frame.data, octets, strict=True)
            ]
        elif name == "ID" and len(bits) > 5:
            width = 8 if frame.extended else 3
            shown = (
                f"ID 0x{frame.can_id:0{width}X}"
                if not any(span.name.startswith("ID") for span in spans)
                else "ID, the rest"
            )
            spans.append(BitSpan(shown, "", "who", bits))
        elif name in ("CRC", "DLC"):
            value = int("".join(str(bit.level) for bit in bits if not bit.stuff), 2)
            shown = f"CRC {value:04X}" if name == "CRC" else f"DLC {value}"
            spans.append(BitSpan(shown, "", _KINDS.get(name, "control"), bits))
        else:
            spans.append(BitSpan(_NAMES.get(name, name), "", _KINDS.get(name, "control"), bits))
    return spans


def rows_of(spans: list[BitSpan]) -> list[list[BitSpan]]:
    """The fields in rows that are not too long."""
    rows: list[list[BitSpan]] = []
    room = 0
    for span in spans:
        if len(span.bits) > room:
            rows.append([])
            room = ROW_BITS
        rows[-1].append(span)
        room -= len(span.bits)
    return rows


def _fields(bits: list[WireBit]) -> list[tuple[str, list[WireBit]]]:
    """Neighbouring bits of the same field."""
    found: list[tuple[str, list[WireBit]]] = []
    for bit in bits:
        if not found or found[-1][0] != bit.field:
            found.append((bit.field, []))
        found[-1][1].append(bit)
    return found


def split_by_octets(bits: list[WireBit], octets: tuple[int, ...]) -> list[list[WireBit]]:
    """Data bits in pieces of so many octets; a stuff bit stays with the bit before it."""
    pieces: list[list[WireBit]] = []
    start = 0
    for count in octets:
        end, left = start, 8 * count
        while end < len(bits) and (left or bits[end].stuff):
            left -= not bits[end].stuff
            end += 1
        pieces.append(bits[start:end])
        start = end
    return pieces


class Canvas:
    """Collects the elements of the picture."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def text(self, x: float, y: float, words: str, style: str = "", *, turn: float | None = None) -> None:
        """Words at a place, turned around it by so many degrees."""
        place = f'x="{x:g}" y="{y:g}"' if turn is None else f'transform="translate({x:g} {y:g}) rotate({turn:g})"'
        self.lines.append(f'<text {place} class="{style}">{escape(words)}</text>')

    def box(self, x: float, y: float, width: float, height: float, style: str, *, radius: float = 0) -> None:
        """A rectangle."""
        place = f'x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}"'
        self.lines.append(f'<rect {place} rx="{radius:g}" class="{style}"/>')

    def line(self, x1: float, y1: float, x2: float, y2: float, style: str) -> None:
        """A straight line."""
        self.lines.append(f'<line x1="{x1:g}" y1="{y1:g}" x2="{x2:g}" y2="{y2:g}" class="{style}"/>')

    def path(self, steps: list[str], style: str) -> None:
        """A free line."""
        self.lines.append(f'<path d="{" ".join(steps)}" class="{style}"/>')


def trace(levels: list[int], before: int, left: float, base: float, swing: float) -> list[str]:
    """One wire: a dominant bit (0) drives it by `swing`, a recessive one (1) lets it fall back."""

    def height(level: int) -> float:
        return base + (0 if level else swing)

    steps = [f"M {left - 8:g} {height(before):g}", f"H {left:g}"]
    for place, level in enumerate(levels):
        x = left + place * CELL
        was = before if place == 0 else levels[place - 1]
        if level != was:
            # Driven quickly, let go more slowly: the terminators discharge the wire.
            bend = (2, 3, 4) if level == 0 else (1.5, 2.5, 8)
            steps.append(
                f"C {x + bend[0]:g} {height(was) if level == 0 else height(level):g} {x + bend[1]:g} {height(level):g} "
                f"{x + bend[2]:g} {height(level):g}"
            )
        steps.append(f"H {x + CELL:g}")
    return steps


def draw_row(canvas: Canvas, spans: list[BitSpan], top: float, before: list[WireBit], times_us: list[float]) -> None:
    """A row of the picture: names, traces, bits, and the time; `times_us` is when each bit of the frame begins."""
    first = len(before)
    bits = [bit for span in spans for bit in span.bits]
    right = LEFT + len(bits) * CELL
    scope = top + 62
    canvas.box(LEFT - 8, scope - 12, right - LEFT + 16, LOW + 24, "scope", radius=4)
    for depth, words in LEVELS:
        canvas.line(LEFT - 8, scope + depth, right + 8, scope + depth, "zero" if depth == MIDDLE else "grid")
        canvas.text(LEFT - 14, scope + depth + 4, words, "volt soft")
    _draw_spans(canvas, spans, top)
    _draw_stuffing(canvas, before, bits, scope)
    levels = [bit.level for bit in bits]
    last = before[-1].level if before else 1
    # A hair apart, so that both are seen where they are alike.
    canvas.path(trace(levels, last, LEFT, scope + MIDDLE + 1.2, LOW - MIDDLE), "l")
    canvas.path(trace(levels, last, LEFT, scope + MIDDLE - 1.2, HIGH - MIDDLE), "h")
    for place, bit in enumerate(bits):
        style = "bit stuff-text" if bit.stuff else "bit"
        canvas.text(LEFT + (place + 0.5) * CELL, scope + LOW + 31, str(bit.level), style)
    for place in range(-first % 5, len(bits) + 1, 5):
        x = LEFT + place * CELL
        canvas.line(x, scope + LOW + 48, x, scope + LOW + 53, "tock")
        microseconds = round(times_us[first + place], 3)
        canvas.text(x, scope + LOW + 65, f"{microseconds:g} µs" if place < 5 else f"{microseconds:g}", "tick soft")


def _draw_spans(canvas: Canvas, spans: list[BitSpan], top: float) -> None:
    x: float = LEFT
    for span in spans:
        width = len(span.bits) * CELL
        canvas.box(x + 1, top + 22, width - 2, 20, span.kind, radius=3)
        canvas.line(x, top + 42, x, top + 62 + LOW + 38, "grid")
        if width >= 3 * CELL:
            canvas.text(x + width / 2, top + 36, span.name, "name")
            canvas.text(x + width / 2, top + 14, span.meaning, "mean soft")
        else:
            canvas.text(x + width / 2 + 3, top + 17, span.name, "side soft", turn=-38)
        x += width


def _draw_stuffing(canvas: Canvas, before: list[WireBit], bits: list[WireBit], scope: float) -> None:
    for place, bit in enumerate(bits):
        x = LEFT + place * CELL
        if bit.field == "ACK":
            canvas.box(x, scope - 12, CELL, LOW + 50, "others")
        if not bit.stuff:
            continue
        canvas.box(x, scope - 12, CELL, LOW + 50, "stuff")
        start = x - min(5, place + len(before)) * CELL if place >= 5 else LEFT - 6
        y = scope + LOW + 41
        canvas.path([f"M {start + 3:g} {y - 4:g}", f"V {y:g}", f"H {x - 3:g}", f"V {y - 4:g}"], "run")


def legend(canvas: Canvas, top: float) -> None:
    """What the signs mean."""
    left, middle, right = 24, 262, 556
    canvas.line(left, top - 4, left + 24, top - 4, "h")
    canvas.text(left + 32, top, "CAN-H", "h-text")
    canvas.line(left + 94, top - 4, left + 118, top - 4, "l")
    canvas.text(left + 126, top, "CAN-L", "l-text")
    for line, words in enumerate(("apart: dominant, a 0", "together: recessive, a 1")):
        canvas.text(left + 32, top + 18 * (line + 1), words, "soft")
    canvas.box(middle, top - 14, CELL, 20, "stuff")
    canvas.text(middle + 7, top + 1, "1", "stuff-text")
    stuffing = (
        "A stuff bit: after five equal bits the",
        "sender puts in one of the other level,",
        "so that receivers keep in step.",
    )
    for line, words in enumerate(stuffing):
        canvas.text(middle + 32, top + 18 * line, words, "soft")
    canvas.box(right, top - 14, CELL, 20, "others")
    for line, words in enumerate(
        ("Here the sender lets go. Whoever", "got the frame right makes the bit", "dominant: it has arrived.")
    ):
        canvas.text(right + 32, top + 18 * line, words, "soft")


def frame_svg(
    title: str, rows: list[list[BitSpan]], *, bitrate: int, data_bitrate: int | None = None, kind: str = "classic"
) -> str:
    """A picture with a title.

    Args:
        title: what the frame is.
        rows: all its bits.
        bitrate: bit/s.
        data_bitrate: of the fast part of a CAN FD frame; None: the same.
        kind: `classic` or `FD`.
    """
    bits = [bit for row in rows for span in row for bit in span.bits]
    stuffed = sum(bit.stuff for bit in bits)
    lengths = [1_000_000 / ((data_bitrate or bitrate) if bit.fast else bitrate) for bit in bits]
    times_us = [0.0, *accumulate(lengths)]
    height = TOP + len(rows) * ROW + 70
    canvas = Canvas()
    canvas.box(0.5, 0.5, WIDTH - 1, height - 1, "panel", radius=8)
    canvas.text(24, 36, title, "title")
    rate = f"{bitrate / 1000:g} kbit/s"
    if any(bit.fast for bit in bits):
        rate += f", its fast part at {(data_bitrate or bitrate) / 1000:g} kbit/s"
    words = (
        f"one {kind} CAN frame at {rate}: {len(bits)} bits, {stuffed} of them stuff bits, {round(times_us[-1], 3):g} µs"
    )
    canvas.text(24, 58, words, "soft")
    first = 0
    for number, spans in enumerate(rows):
        draw_row(canvas, spans, TOP + number * ROW, bits[:first], times_us)
        first += sum(len(span.bits) for span in spans)
    legend(canvas, TOP + len(rows) * ROW + 16)
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" role="img">'
    name = f"<title>{escape(f'{title}: {words}')}</title>"
    return "\n".join([head, name, f"<style>{STYLE}</style>", *canvas.lines, "</svg>", ""])


def frame_picture(frame: Frame, *, bitrate: int, data_bitrate: int | None = None) -> str:
    """Any frame as SVG."""
    title = f"The frame {format_frame(frame)}"
    return frame_svg(
        title if len(title) <= LONGEST_TITLE else f"{title[: LONGEST_TITLE - 1]}…",
        rows_of(spans_of(frame)),
        bitrate=bitrate,
        data_bitrate=data_bitrate,
        kind="FD" if frame.fd else "classic",
    )


LONGEST_TITLE = 66


def frame_lines(frame: Frame, width: int = 80) -> list[str]:
    """Any frame as lines of text, at most `width` wide: names, CAN-H and CAN-L, bits; `^` is below a stuff bit."""
    spans = spans_of(frame)
    cells: list[tuple[str, WireBit]] = []
    for span in spans:
        name = span.name.replace("DATA ", "").replace("ID 0x", "").replace("CRC end", "").replace("ACK end", "")
        shown = f"|{name}"[: len(span.bits)] if len(span.bits) > 1 else "|"
        cells += zip(shown.ljust(len(span.bits)), span.bits, strict=True)
    lines: list[str] = []
    room = max(width - 7, 16)
    for first in range(0, len(cells), room):
        row = cells[first : first + room]
        bits = [bit for _, bit in row]
        lines += [
            "       " + "".join(letter for letter, _ in row).rstrip(),
            "CAN-H  " + "".join("─" if bit.level else "▀" for bit in bits),
            "CAN-L  " + "".join("─" if bit.level else "▄" for bit in bits),
            "bits   " + "".join(str(bit.level) for bit in bits),
            ("       " + "".join("^" if bit.stuff else " " for bit in bits)).rstrip(),
        ]
    return lines
