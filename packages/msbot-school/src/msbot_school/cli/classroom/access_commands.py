"""`msbot class join|leave`: an access to a robot on another computer, and its end."""

from __future__ import annotations

import hashlib
import json
import os
import socket
import ssl
import sys
import time
from urllib.parse import urlsplit

import click

from msbot_agent.cli.options import FiniteRange, json_option
from msbot_school.classroom.remote_access import RemoteAccess, RemoteAccessFile, page_address
from msbot_school.classroom.remote_masters import Answer, RemoteMasterConnection, ask_one
from msbot_xrce.errors import ConfigError

TOKEN = "MSBOT_TOKEN"
PATIENCE_S = 10.0
"""How long the one robot is waited for that somebody wants in the class: it may be a small computer with much to do."""


@click.command("join")
@click.argument("address")
@click.option("--fingerprint", metavar="SHA256", help="The certificate to trust there, by its SHA-256 fingerprint.")
def join(address: str, fingerprint: str | None) -> None:
    """Add the robot whose page is at ADDRESS to the class, with an API token of that page.

    The token is asked for, or read from $MSBOT_TOKEN. The class gets the rights of its person.
    """
    where = page_address(address)
    book = RemoteAccessFile()
    book.all()  # a file that cannot be used is said before anybody types
    certificate = _agreed_certificate(where, fingerprint)
    ask_one(RemoteAccess(where, "none", "", "", certificate), _health, PATIENCE_S)
    token = _token()
    if not token.isascii() or not token.isprintable() or " " in token:
        raise ConfigError("this is no API token: it is one word like msbot_..., from the page Admin of that robot")
    status, me = ask_one(RemoteAccess(where, token, "", "", certificate), _look, PATIENCE_S)
    access = RemoteAccess(where, token, str(status.get("robot")), str(status.get("serial_number")), certificate)
    book.add(access)
    click.echo(
        f"{access.robot} {access.serial_number} at {where} is in the class as {me.get('name')} ({me.get('role')})"
    )
    if "design" not in me.get("rights", []):
        click.echo(
            f"as {me.get('role')}, the class may say STOP there; to change the blueprint takes a teacher's token"
        )
    if where.startswith("http://"):
        click.echo(
            "what travels there can be read by others in the network, the token too: give that master a --certificate"
        )


@click.command("leave")
@click.argument("robot")
def leave(robot: str) -> None:
    """Remove ROBOT (name, serial number or address) from the class: forget its access."""
    book = RemoteAccessFile()
    fitting = [one for one in book.all() if robot in (one.robot, one.serial_number, one.address)]
    if not fitting:
        raise ConfigError(f"there is no access to {robot}: `msbot class list` shows who is in the class")
    if len(fitting) > 1:
        addresses = ", ".join(one.address for one in fitting)
        raise ConfigError(f"{len(fitting)} robots are called {robot}: say which one by its address: {addresses}")
    book.take_away(fitting[0])
    click.echo(
        f"{fitting[0].robot} {fitting[0].serial_number} at {fitting[0].address} is in the class no more; the "
        "token is valid until it is revoked on that robot's page Admin"
    )


def _token() -> str:
    token = os.environ.get(TOKEN, "").strip()
    if not token and not sys.stdin.isatty():
        raise ConfigError(f"nobody is there to type the API token: put it into ${TOKEN}")
    return token or str(click.prompt("API token", hide_input=True)).strip()


def _health(line: RemoteMasterConnection) -> Answer:
    """Whether a page of MsBOT answers at all; nothing secret goes there."""
    return line.mapping("GET", "/api/health")


def _look(line: RemoteMasterConnection) -> tuple[Answer, Answer]:
    return line.mapping("GET", "/api/status"), line.mapping("GET", "/api/me")


def _agreed_certificate(where: str, fingerprint: str | None) -> str:
    """The certificate that alone is trusted there, PEM; empty: one that this computer trusts anyway.

    Nothing secret is sent to find it out.

    Raises:
        ConfigError: nobody answers, or it is another one.
    """
    if not where.startswith("https://"):
        if fingerprint:
            raise ConfigError("--fingerprint is for pages with a certificate: https://...")
        return ""
    if fingerprint is None and _connect(where, ssl.create_default_context()) is not None:
        return ""
    anybody = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    anybody.check_hostname, anybody.verify_mode = False, ssl.CERT_NONE
    octets = _connect(where, anybody)
    if octets is None:
        raise ConfigError(f"{where}: no certificate comes from there")
    found = hashlib.sha256(octets).hexdigest()
    shown = ":".join(found[place : place + 2].upper() for place in range(0, len(found), 2))
    if fingerprint is not None:
        if fingerprint.replace(":", "").lower() != found:
            raise ConfigError(f"{where}: its certificate is another one, {shown}; nothing was sent")
    else:
        click.echo(f"nobody whom this computer trusts vouches for the certificate of {where}. Its SHA-256 fingerprint:")
        click.echo(shown)
        click.echo("there it is shown by: openssl x509 -in CERTIFICATE -noout -fingerprint -sha256")
        click.confirm("Are they the same?", abort=True)
    return ssl.DER_cert_to_PEM_cert(octets)


def _connect(where: str, context: ssl.SSLContext) -> bytes | None:
    """The certificate that is shown there; None: it is not one that `context` trusts."""
    found = urlsplit(where)
    until = time.monotonic() + PATIENCE_S
    try:
        with (
            socket.create_connection((found.hostname or "", found.port or 443), PATIENCE_S) as plain,
            context.wrap_socket(plain, server_hostname=found.hostname) as sealed,
        ):
            sealed.settimeout(max(0.1, until - time.monotonic()))
            return sealed.getpeercert(binary_form=True)
    except ssl.SSLCertVerificationError:
        return None
    except OSError as error:
        raise ConfigError(f"{where}: {error.strerror or 'no answer in time'}") from None


# `msbot class find`: the robots that announce themselves in the network.


SECONDS = 3.0


@click.command("find")
@click.argument("class_name", metavar="[CLASS]", required=False, default="")
@click.option("--seconds", type=FiniteRange(0.5, 60.0), default=SECONDS, show_default=True, help="How long to listen.")
@json_option
def find(class_name: str, seconds: float, *, as_json: bool) -> None:
    """Find the robots in the network that run with --announce, of all classes or of CLASS.

    An announcement gives no rights: to stop or change a robot, you need access (`msbot class join`).
    """
    from msbot_school.classroom import mdns  # the other commands of the class do not need it

    accesses = {one.address for one in RemoteAccessFile().all()}
    found = mdns.find_masters(seconds, class_name)
    if as_json:
        told = [
            {
                "name": one.robot,
                "serial_number": one.serial_number,
                "version": one.version,
                "class": one.class_name,
                "page": one.address,
                "has_access": one.address in accesses,
            }
            for one in found
        ]
        click.echo(json.dumps(told))
        return
    if not found:
        who = f"for class {class_name} " if class_name else ""
        click.echo(f"Nobody announces a robot {who}in these networks; `msbot master --announce CLASS` does.")
    for one in found:
        access = "in the class" if one.address in accesses else f"no access: msbot class join {one.address}"
        click.echo(f"{one.robot} {one.serial_number}  {one.version}  class {one.class_name}  {one.address}  {access}")
