"""Lists drawn as what they are: bars, lamps in a row, the fan of a scanner, a small picture. Pure: values in, SVG out.

A list is one text of JSON among the fields of a message, see `LiveValues.fields`.
"""

from __future__ import annotations

import base64
import json
import math
import struct
import zlib
from collections.abc import Mapping
from typing import Any

from msbot_agent.text.sentence import said
from msbot_web.models.robot_models import Scalar

Fields = Mapping[str, Scalar]
Drawing = Mapping[str, object]

SIDE = 84
"""Width and height of a drawing."""
MOST_BARS = 60
"""A longer list is drawn by as many of its elements, spread evenly."""
MOST_RAYS = 120
MOST_LAMPS = 64
MOST_PIXELS = 64 * 64
WORDS_SHOWN = 6


def listed(value: object) -> list[Any]:
    """The elements of a list as it stands among fields; none if it is none."""
    if not isinstance(value, str) or not value.startswith("["):
        return []
    try:
        found = json.loads(value)
    except (ValueError, RecursionError):
        return []
    return found if isinstance(found, list) else []


def short_list(value: str) -> str:
    """The first elements of a list, and how many there are: `[1, 2, 3, 4, 5, 6, ... 360]`."""
    found = listed(value)
    if len(found) <= WORDS_SHOWN:
        return value
    return f"[{', '.join(json.dumps(one) for one in found[:WORDS_SHOWN])}, ... {len(found)}]"


def bars(values: list[Any]) -> Drawing:
    """A bar for each number, upwards from the lowest or from 0."""
    numbers = [float(one) for one in _spread(values, MOST_BARS) if _is_number(one)]
    low, high = min([0.0, *numbers]), max([0.0, *numbers])
    span = (high - low) or 1.0
    width = 76 / max(len(numbers), 1)
    zero = 66 - (0 - low) / span * 58
    drawn = []
    for place, number in enumerate(numbers):
        top = 66 - (number - low) / span * 58
        drawn.append(
            {
                "x": f"{4 + place * width:.1f}",
                "y": f"{min(top, zero):.1f}",
                "width": f"{max(width - (1 if width > 3 else 0), 0.5):.1f}",
                "height": f"{max(abs(zero - top), 0.8):.1f}",
            }
        )
    return {
        "kind": "bars",
        "bars": drawn,
        "under": f"{len(values)}",
        "said": said("{count} values", count=len(values)),
    }


def lamps(fields: Fields) -> Drawing:
    """A dot for each lamp of a strip, in rows."""
    colours = [one for one in listed(fields.get("colours")) if isinstance(one, list) and len(one) == 3][:MOST_LAMPS]
    columns = max(1, math.ceil(math.sqrt(len(colours))) if len(colours) > 8 else min(len(colours), 4))
    rows = math.ceil(len(colours) / columns)
    step = min(76 / columns, 64 / max(rows, 1), 18.0)
    left, top = (SIDE - step * columns) / 2, max(2.0, (68 - step * rows) / 2)
    dots = [
        {
            "x": f"{left + (place % columns + 0.5) * step:.1f}",
            "y": f"{top + (place // columns + 0.5) * step:.1f}",
            "colour": _colour(one),
        }
        for place, one in enumerate(colours)
    ]
    lit = sum(any(one) for one in colours)
    words = said("{lit} of {count} lamps shine", lit=lit, count=len(colours))
    return {
        "kind": "lamps",
        "dots": dots,
        "radius": f"{step * 0.42:.1f}",
        "under": f"{lit}/{len(colours)}",
        "said": words,
    }


def fan(fields: Fields) -> Drawing:
    """What a scanner sees around it, from above; straight ahead is up."""
    metres = listed(fields.get("metres"))
    begin, step = _number(fields.get("angle_min")), _number(fields.get("angle_step"))
    reach = _number(fields.get("reach")) or max((one for one in metres if _is_number(one)), default=0.0) or 1.0
    every = max(1, math.ceil(len(metres) / MOST_RAYS))
    points, nearest = [], math.inf
    nearest_at = 0.0
    for place, one in enumerate(metres):
        angle, distance = begin + place * step, float(one) if _is_number(one) else math.inf
        if distance <= reach and distance < nearest:
            nearest, nearest_at = distance, angle
        if place % every == 0:
            length = 34 * max(0.0, min(distance / reach, 1.0))
            turned = math.radians(angle + 90)
            points.append(f"{42 + length * math.cos(turned):.1f},{36 - length * math.sin(turned):.1f}")
    if math.isinf(nearest):
        return {"kind": "fan", "points": " ".join(points), "under": "nothing", "said": said("nothing within reach")}
    words = said("nearest {metres:.2f} m at {degrees:.0f}°", metres=nearest, degrees=nearest_at)
    return {"kind": "fan", "points": " ".join(points), "under": f"{nearest:.2f} m", "said": words}


def picture(fields: Fields) -> Drawing:
    """A small picture, its pixels as squares."""
    width, height = int(_number(fields.get("width"))), int(_number(fields.get("height")))
    octets = 3 if fields.get("format") == "rgb8" else 1
    pixels = [one for one in listed(fields.get("pixels")) if isinstance(one, int) and 0 <= one < 256]
    if not 0 < width * height <= MOST_PIXELS or len(pixels) != width * height * octets:
        return {"kind": "nothing"}
    scale = min(76 / width, 64 / height)
    return {
        "kind": "picture",
        "source": f"data:image/png;base64,{base64.b64encode(png(width, height, bytes(pixels))).decode()}",
        "x": f"{(SIDE - width * scale) / 2:.1f}",
        "y": f"{4 + (64 - height * scale) / 2:.1f}",
        "width": f"{width * scale:.1f}",
        "height": f"{height * scale:.1f}",
        "under": f"{width} x {height}",
        "said": said("a picture of {width} x {height} pixels", width=width, height=height),
    }


def png(width: int, height: int, pixels: bytes) -> bytes:
    """Pixels of one byte (grey) or three (red, green, blue) as a PNG file (ISO/IEC 15948)."""
    row = len(pixels) // height
    rows = b"".join(b"\0" + pixels[at : at + row] for at in range(0, len(pixels), row))
    kind = 2 if row == 3 * width else 0
    head = struct.pack(">IIBBBBB", width, height, 8, kind, 0, 0, 0)
    chunks = ((b"IHDR", head), (b"IDAT", zlib.compress(rows, 1)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data)) for name, data in chunks
    )


def _colour(rgb: list[Any]) -> str:
    red, green, blue = (max(0, min(255, int(_number(one)))) for one in rgb)
    return f"#{red:02x}{green:02x}{blue:02x}"


def _spread(values: list[Any], most: int) -> list[Any]:
    if len(values) <= most:
        return values
    return [values[place * len(values) // most] for place in range(most)]


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) and _is_number(value) else 0.0
