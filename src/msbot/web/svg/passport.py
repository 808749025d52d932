"""What identifies a part type on paper: its picture with the pins, and a QR code that leads to its page."""

from __future__ import annotations

import io

from msbot.config import PartType
from msbot.config.library.picture import picture_svg
from msbot.web.html import Markup


def picture_of(part_type: PartType) -> Markup:
    """The picture of a part type as SVG; what is drawn in it was checked when the library was read."""
    return Markup(picture_svg(part_type))


def qr_svg(text: str, *, scale: int = 4) -> Markup:
    """A QR code (ISO/IEC 18004) of a text as SVG, black on white so that every camera reads it."""
    import segno  # no first page has a QR code

    out = io.BytesIO()
    segno.make(text, error="m").save(out, kind="svg", scale=scale, border=2, light="#fff", xmldecl=False, svgns=True)
    return Markup(out.getvalue().decode())
