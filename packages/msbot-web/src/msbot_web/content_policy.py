"""What a browser may run, show and ask for on our pages: the Content-Security-Policy of every answer.

A text of a stranger that reaches a page as HTML, by whatever mistake, runs no script: `'unsafe-inline'` is not there,
so that neither an attribute such as `onerror` nor a `<script>` runs. The few scripts that NiceGUI writes into a page
carry a word that is made anew for each answer (a nonce). All others are files of this server.

What remains, and why: `'unsafe-eval'`, because NiceGUI runs what the robot sends to its own page by `eval`, and Vue
compiles its templates in the browser; `'unsafe-inline'` for styles, because both write `style="..."`.
"""

from __future__ import annotations

import re
import secrets
from collections.abc import Callable

from jinja2 import BaseLoader, Environment

NONCE = "nonce"
"""Where a request's word is, in its state."""
_SCRIPT = re.compile(r"<script\b")


def new_nonce() -> str:
    """The word of one answer."""
    return secrets.token_urlsafe(16)


def page_policy(nonce: str) -> bytes:
    """The value of the header, for a page whose own scripts carry this word."""
    return (
        f"default-src 'self'; script-src 'self' 'nonce-{nonce}' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
        "img-src 'self' data:; font-src 'self' data:; connect-src 'self'; object-src 'none'; "
        "frame-ancestors 'none'; base-uri 'self'; form-action 'self'"
    ).encode()


class NonceLoader(BaseLoader):
    """Gives the request's word to the scripts that stand in a template itself, and not to what is filled into it.

    Args:
        loader: where the templates come from.
    """

    def __init__(self, loader: BaseLoader) -> None:
        self._loader = loader

    def get_source(self, environment: Environment, template: str) -> tuple[str, str | None, Callable[[], bool] | None]:
        """As the environment asks for it."""
        source, path, is_current = self._loader.get_source(environment, template)
        return _SCRIPT.sub(f'<script nonce="{{{{ request.scope.state.{NONCE} }}}}"', source), path, is_current
