"""The answers of the API that say nothing of a robot: that the server runs, and every refusal."""

from __future__ import annotations

from msbot.web.api.model import Model


class Health(Model):
    """Whether the server runs; the one answer that needs no session."""

    status: str = "ok"


class ProblemAnswer(Model):
    """What every refusal looks like."""

    error: str
