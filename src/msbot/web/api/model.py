"""What all models of the API have in common."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class Model(BaseModel):
    """Base: values are never changed, and unknown fields in a request are an error."""

    model_config = ConfigDict(frozen=True, extra="forbid")
