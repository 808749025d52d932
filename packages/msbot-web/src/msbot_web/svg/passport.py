"""What identifies a part type on paper: its picture with the pins, and a QR code that leads to its page."""

from __future__ import annotations

import base64
import io

from msbot.config import PartType
from msbot.config.library.picture import picture_svg
from msbot_web.html import Markup, render


def picture_of(part_type: PartType) -> Markup:
    """The picture of a part type, which a stranger may have sent.

    As an image, not as a piece of the page: nothing in it is HTML, runs, or fetches anything, whatever it holds.
    """
    data = base64.b64encode(picture_svg(part_type).encode()).decode()
    return render(
        "part_picture", source=f"data:image/svg+xml;base64,{data}", words=f"{part_type.number}: {part_type.name}"
    )


def qr_svg(text: str, *, scale: int = 4) -> Markup:
    """A QR code (ISO/IEC 18004) of a text as SVG, black on white so that every camera reads it."""
    import segno  # no first page has a QR code

    out = io.BytesIO()
    segno.make(text, error="m").save(out, kind="svg", scale=scale, border=2, light="#fff", xmldecl=False, svgns=True)
    return Markup(out.getvalue().decode())
