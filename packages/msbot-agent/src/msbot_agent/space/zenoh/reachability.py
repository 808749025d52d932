"""Why a router cannot be reached, in a sentence: the library itself only says that it cannot."""

from __future__ import annotations

import socket
import ssl

from msbot_agent.space.space_address import TlsFiles
from msbot_agent.space.zenoh.library import load, session_config
from msbot_agent.text.given_file import LARGEST_PEM, read_given
from msbot_xrce.errors import ConfigError

PATIENCE_S = 3.0
"""How long a connection may take."""
VERDICT_S = 0.5
"""How long the other end may take to refuse our certificate after the handshake (TLS 1.3)."""

_THEIRS = "its certificate is not accepted here"
_OURS = "it does not accept our certificate, or wants one"


def check_files(tls: TlsFiles) -> None:
    """Read the certificates.

    Raises:
        ConfigError: one of them cannot be used; the text names the file.
    """
    context(tls)


def context(tls: TlsFiles) -> ssl.SSLContext:
    """The certificates as Python's TLS takes them.

    Raises:
        ConfigError: one of them cannot be used.
    """
    for file in (tls.ca, tls.certificate, tls.key):
        if file is not None:
            try:
                read_given(file, LARGEST_PEM, "a PEM file")
            except OSError as error:
                raise ConfigError(f"{file}: cannot be read ({error.strerror}); it should be a PEM file") from None
    try:
        made = ssl.create_default_context(cafile=str(tls.ca))
    except ssl.SSLError:
        raise ConfigError(f"{tls.ca}: is no certificate in PEM form") from None
    # Python 3.13 asks more of a certificate (a key usage, RFC 5280) than Zenoh's library does, whose view is told.
    made.verify_flags &= ~ssl.VERIFY_X509_STRICT
    if tls.certificate is not None and tls.key is not None:
        try:
            made.load_cert_chain(tls.certificate, tls.key)
        except ssl.SSLError as error:
            differ = "MISMATCH" in str(error)
            what = "do not belong together" if differ else "are no certificate and its key in PEM form"
            raise ConfigError(f"{tls.certificate} and {tls.key}: {what}") from None
    return made


def unreachable(endpoint: str, tls: TlsFiles | None) -> str:
    """Why no session with the router can be opened; empty: one was, and is closed again. Waits for the network.

    Raises:
        ConfigError: the library is not here.
    """
    library = load()
    try:
        library.open(session_config("client", connect=[endpoint], tls=tls)).close()
    except library.ZError:
        return why_not(endpoint, tls)
    return ""


def why_not(endpoint: str, tls: TlsFiles | None) -> str:
    """Try the endpoint, and say what is in the way. Waits for the network: not for the event loop."""
    kind, _, place = endpoint.partition("/")
    host, _, port = place.rpartition(":")
    host = host.strip("[]")
    try:
        with socket.create_connection((host, int(port)), PATIENCE_S) as connection:
            if kind == "tls" and tls is not None:
                return _why_not_tls(connection, host, tls)
    except ConfigError as error:
        return str(error)
    except OSError as error:
        return error.strerror or "it does not answer"
    return "it answers, but not as a Zenoh router: is that address right, and is it tcp/ or tls/?"


def _why_not_tls(connection: socket.socket, host: str, tls: TlsFiles) -> str:
    try:
        with context(tls).wrap_socket(connection, server_hostname=host) as secure:
            secure.settimeout(VERDICT_S)
            secure.recv(1)
    except ssl.SSLCertVerificationError as error:
        return f"{_THEIRS}: {error.verify_message}"
    except TimeoutError:
        pass  # it has accepted us, and waits for us to say something
    except (ssl.SSLError, ConnectionError) as error:
        return f"{_OURS}: {_reason(error)}"
    return "it answers, but not as a Zenoh router"


def _reason(error: OSError) -> str:
    if isinstance(error, ssl.SSLError) and error.reason:
        return error.reason.replace("_", " ").lower()
    return error.strerror or "it hung up"
