"""What went wrong, as an answer of the API: a status code and one sentence, never a traceback."""

from __future__ import annotations

import logging

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException

from msbot_agent.text.sentence import whole
from msbot_web.access.access_middleware import is_client_gone
from msbot_web.access.accounts import NotAllowed, SignedOut
from msbot_web.access.passwords import TooManyHashes
from msbot_web.access.sessions import Session
from msbot_web.access.sign_in_throttle import SignInRefused
from msbot_web.api.dependencies import words_for
from msbot_web.gallery import AskFirst
from msbot_web.language import language_of
from msbot_xrce.errors import DatabaseBusy, MsbotError, NotThere, RegistryError

_log = logging.getLogger(__name__)


def status_of(error: MsbotError) -> int:
    """The HTTP status that fits an error."""
    match error:
        case NotThere():
            return 404
        case NotAllowed():
            return 403
        case TooManyHashes():
            return 429
        case SignedOut():
            return 401
        case SignInRefused():
            return 429 if error.retry_after_s else 401
        case DatabaseBusy():
            return 423
        case AskFirst():
            return 409
        case RegistryError():
            return 409
    return 400


def add_exception_handlers(app: FastAPI) -> None:
    """Have all errors answered as `{"error": sentence}`."""

    async def known(request: Request, error: Exception) -> JSONResponse:
        assert isinstance(error, MsbotError)
        session = request.scope.get("state", {}).get("session")
        words = words_for(session, str(error)) if isinstance(session, Session) else str(error)
        return JSONResponse({"error": whole(language_of(request).translate(words))}, status_of(error))

    async def invalid(_request: Request, error: Exception) -> JSONResponse:
        assert isinstance(error, RequestValidationError)
        faults = [f"{'.'.join(str(step) for step in fault['loc'])}: {fault['msg']}" for fault in error.errors()]
        return JSONResponse({"error": whole("; ".join(faults))}, 422)

    async def unreadable(_request: Request, error: Exception) -> JSONResponse:
        assert isinstance(error, HTTPException)
        return JSONResponse({"error": str(error.detail)}, 400)

    async def unknown(request: Request, error: Exception) -> JSONResponse:
        if is_client_gone(request.scope, error):
            return JSONResponse({"error": "nobody waits for this answer"}, 500)
        _log.error("the answer to %s %s failed", request.method, request.url.path, exc_info=error)
        return JSONResponse({"error": "something went wrong in the server; its log says what"}, 500)

    app.add_exception_handler(MsbotError, known)
    app.add_exception_handler(RequestValidationError, invalid)
    app.add_exception_handler(400, unreadable)
    app.add_exception_handler(Exception, unknown)
