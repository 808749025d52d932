"""What all models of the API have in common."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from pydantic import BaseModel, ConfigDict


@contextmanager
def _built_at_first_use() -> Iterator[None]:
    """Models that are made here get their validators when one of them is first used."""
    BaseModel.model_config["defer_build"] = True
    try:
        yield
    finally:
        del BaseModel.model_config["defer_build"]


with _built_at_first_use():
    # Those of an OpenAPI description: a quarter of what it takes to load FastAPI, and hardly ever used.
    import fastapi.openapi.models  # noqa: F401


class Model(BaseModel):
    """Base: values are never changed, and unknown fields in a request are an error."""

    model_config = ConfigDict(frozen=True, extra="forbid")
