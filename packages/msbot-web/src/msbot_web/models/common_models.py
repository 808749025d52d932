"""The answers of the API that say nothing of a robot: that the server runs, and every refusal."""

from __future__ import annotations

from msbot_web.models.robot_models import Model


class Health(Model):
    """Whether the server runs; the one answer that needs no session."""

    status: str = "ok"


class ProblemAnswer(Model):
    """What every refusal looks like."""

    error: str


PROBLEMS: dict[int | str, dict[str, object]] = {
    400: {"model": ProblemAnswer, "description": "It cannot be done; the sentence says why and what would be right."},
    401: {"model": ProblemAnswer, "description": "Nobody is signed in."},
    403: {"model": ProblemAnswer, "description": "The role does not allow it."},
    404: {"model": ProblemAnswer, "description": "There is no such thing."},
    409: {"model": ProblemAnswer, "description": "The database does not take it at the moment."},
    413: {"model": ProblemAnswer, "description": "The body is too large."},
    422: {"model": ProblemAnswer, "description": "The request does not fit the schema."},
    423: {
        "model": ProblemAnswer,
        "description": "Another program writes to the database: nothing has changed, try again.",
    },
    429: {"model": ProblemAnswer, "description": "Calls come too often; the header Retry-After says when to go on."},
}
"""What every call can answer besides its result."""
