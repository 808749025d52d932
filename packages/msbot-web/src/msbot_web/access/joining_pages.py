"""What a pupil sees who comes in with a ticket, a code or the own name: plain pages that need no script.

Looking at a ticket does not use it, only a press of its button: cameras and chats fetch links to show what is behind
them. The pages are `/pass` for a pupil's own ticket and `/come` for the class: code, then name, then pictures; or a new
name, and waiting for the teacher.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from urllib.parse import urlencode

from fastapi import APIRouter, Request
from fastapi.responses import RedirectResponse, Response

from msbot_agent.text.sentence import said
from msbot_web.access.joining import CHOICES, PICTURES, WaitState
from msbot_web.access.sign_in_throttle import SignInRefused
from msbot_web.access.ticket_codes import TicketCodes
from msbot_web.language import language_of
from msbot_xrce.errors import MsbotError

AFTER = "/program"
"""Where a pupil comes to."""
LOOK_S = 3
"""How often a browser that waits asks."""


class JoiningPages:
    """See the module's docstring.

    Args:
        passes: tickets of pupils and of classes.
        page: makes a page from a template.
        signed_in: answers with a session's cookie.
        form_of: reads a form.
        address_of: where a request comes from.
    """

    def __init__(
        self,
        passes: TicketCodes,
        *,
        page: Callable[..., Response],
        signed_in: Callable[..., Response],
        form_of: Callable[[Request], Awaitable[dict[str, str]]],
        address_of: Callable[[Request], str],
    ) -> None:
        self._passes = passes
        self._page = page
        self._signed_in = signed_in
        self._form_of = form_of
        self._address_of = address_of

    def add_to(self, router: APIRouter) -> None:
        """Add the pages."""
        router.add_api_route("/pass", self._show_pass, methods=["GET"])
        router.add_api_route("/pass", self._use_pass, methods=["POST"])
        router.add_api_route("/come", self._show_class, methods=["GET"])
        router.add_api_route("/come", self._come, methods=["POST"])

    # The own ticket

    async def _show_pass(self, request: Request, word: str = "") -> Response:
        try:
            return self._page(request, "pass", "Sign in", word=word, name=self._passes.find(word))
        except SignInRefused as error:
            return self._refused(request, error)

    async def _use_pass(self, request: Request) -> Response:
        form = await self._form_of(request)
        try:
            return self._signed_in(request, self._passes.admit(form.get("word", "")), AFTER)
        except SignInRefused as error:
            return self._refused(request, error)

    # The class

    async def _show_class(self, request: Request, ticket: str = "", wait: str = "") -> Response:
        if wait:
            return self._waiting(request, wait)
        try:
            self._check_nobody_is_here(request)
            if not ticket and "ticket" not in request.query_params:
                return self._page(request, "come_code", "Come in")
            return self._names(request, ticket)
        except SignInRefused as error:
            return self._refused(request, error)

    async def _come(self, request: Request) -> Response:
        form = await self._form_of(request)
        ticket, name = form.get("ticket", ""), form.get("name", "").strip()
        try:
            self._check_nobody_is_here(request)
            if "code" in form:
                return self._by_code(request, form["code"])
            if "wait" in form:
                return self._let_in(request, form["wait"])
            self._passes.find_class(ticket)
            if "pick" in form:
                return await self._by_pictures(request, ticket, form)
            return self._ask(request, ticket, name)
        except SignInRefused as error:
            return self._refused(request, error)

    def _by_code(self, request: Request, code: str) -> Response:
        try:
            ticket = self._passes.codes.ticket_of(code, self._address_of(request))
        except SignInRefused as error:
            words = language_of(request).translate(str(error))
            return self._page(request, "come_code", "Come in", error=words, **_status(error, 403))
        return self._names(request, ticket)

    def _names(self, request: Request, ticket: str, *, status: int = 200, error: str = "", name: str = "") -> Response:
        maker, pupils = self._passes.find_class(ticket).maker, self._passes.pupils()
        shown = {"ticket": ticket, "maker": maker, "pupils": pupils, "name": name[:64], "error": error}
        return self._page(request, "come_in", "Come in", status=status, **shown)

    async def _by_pictures(self, request: Request, ticket: str, form: dict[str, str]) -> Response:
        name = form["pick"]
        if name not in self._passes.pupils():
            return self._names(request, ticket)
        shown = {"ticket": ticket, "pick": name, "pictures": PICTURES, "choices": range(CHOICES)}
        chosen = [form.get(f"picture{place}", "") for place in range(CHOICES)]
        if not any(chosen):
            return self._page(request, "come_pictures", "Come in", **shown)
        try:
            session = await self._passes.admit_by_pictures(name, chosen, self._address_of(request))
        except SignInRefused as error:
            words = language_of(request).translate(str(error))
            return self._page(request, "come_pictures", "Come in", error=words, **shown, **_status(error, 403))
        return self._signed_in(request, session, AFTER)

    def _ask(self, request: Request, ticket: str, name: str) -> Response:
        try:
            word = self._passes.ask_to_come_in(name, ticket)
        except SignInRefused:
            raise
        except MsbotError as error:
            return self._names(request, ticket, status=400, error=language_of(request).translate(str(error)), name=name)
        return RedirectResponse(f"/come?{urlencode({'wait': word})}", status_code=303)

    def _waiting(self, request: Request, word: str) -> Response:
        found = self._passes.waiting.find(word)
        if found is None or found.state is WaitState.REFUSED:
            return self._refused(request, SignInRefused(said("you were not let in: ask your teacher")))
        is_in = found.state is WaitState.LET_IN
        pictures = [PICTURES[number] for number in self._passes.pictures(found.name)] if is_in else []
        shown = {"wait": word, "pupil": found.name, "is_in": is_in, "pictures": pictures, "look_s": LOOK_S}
        return self._page(request, "come_wait", "Come in", **shown)

    def _let_in(self, request: Request, word: str) -> Response:
        return self._signed_in(request, self._passes.admit_waiting(word), AFTER)

    def _refused(self, request: Request, error: MsbotError) -> Response:
        words = language_of(request).translate(str(error))
        return self._page(request, "sign_in", "Sign in", wanted=AFTER, error=words, status=403)

    @staticmethod
    def _check_nobody_is_here(request: Request) -> None:
        """A pupil whose program is held gets no second account at a press.

        Raises:
            SignInRefused: somebody is signed in with this browser.
        """
        session = request.scope["state"].get("session")
        if session is not None:
            raise SignInRefused(said("{name} is signed in here: sign out first", name=session.name))


def _status(error: SignInRefused, usual: int) -> dict[str, object]:
    """Status and headers of an answer that refuses."""
    if not error.retry_after_s:
        return {"status": usual}
    return {"status": 429, "headers": {"retry-after": f"{error.retry_after_s:.0f}"}}
