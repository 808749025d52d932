"""A page that had an upload is freed when it is closed."""

from __future__ import annotations

import gc
import weakref

from fastapi import FastAPI

from msbot_web.nicegui_internals.removed_routes import forget_functions


class Upload:
    """Has a route as NiceGUI's element does."""

    def __init__(self, app: FastAPI) -> None:
        @app.post("/upload")
        async def take() -> str:
            return str(self)

    def delete(self, app: FastAPI) -> None:
        app.routes[:] = [route for route in app.routes if getattr(route, "path", "") != "/upload"]


def test_the_function_of_a_removed_route_is_let_go() -> None:
    app = FastAPI()
    upload = Upload(app)
    upload.delete(app)
    seen = weakref.ref(upload)
    del upload
    forget_functions()
    gc.collect()
    assert seen() is None
