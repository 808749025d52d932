"""The UID of a part that runs on a computer: drawn at random once, kept in the user's state folder."""

from __future__ import annotations

import hashlib
import os
import secrets
from pathlib import Path

from msbot.part.join.pnp_messages import UID_OCTETS
from msbot_agent.process.user_folders import make_own_folder, state_folder
from msbot_xrce.errors import ConfigError


def parse_uid(text: str) -> bytes:
    """A UID from 16 hexadecimal digits; blanks, colons and dashes between them do not count.

    Raises:
        ConfigError: it is something else.
    """
    digits = text.translate(str.maketrans("", "", " :-"))
    try:
        uid = bytes.fromhex(digits)
    except ValueError:
        uid = b""
    if len(uid) != UID_OCTETS:
        raise ConfigError(f"UID {text!r}: write {2 * UID_OCTETS} hexadecimal digits, for example 0011223344556677")
    return uid


def uid_on_board(board: bytes, part_number: str, local_name: str) -> bytes:
    """The UID of a part that is wired to a generic board, from the board's (docs/howto/generic_board.md)."""
    return hashlib.sha256(board + f"{part_number}\0{local_name}".encode()).digest()[:UID_OCTETS]


def kept_file(what: str, part_number: str, local_name: str, folder: Path | None = None) -> Path:
    """The file on this computer that keeps the UID or key of that part; `what` is `uid` or `key`."""
    return (folder or state_folder()) / what / f"{_file_name(part_number)}.{_file_name(local_name)}"


def stored_uid(part_number: str, local_name: str, folder: Path | None = None) -> bytes:
    """The UID of that part on this computer; drawn and stored at the first call.

    Raises:
        ConfigError: the file cannot be read or written, or holds something else.
    """
    path = kept_file("uid", part_number, local_name, folder)
    try:
        return _parse_file(path, path.read_text())
    except FileNotFoundError:
        return _create(path)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"cannot read the part's UID from {path} ({error}): mend the file or use --uid") from None


def write_for_user_alone(path: Path, text: str) -> None:
    """Write a file that only this user can read, in a folder that only this user can look into: in a robot without keys
    a UID is all that a part shows."""
    make_own_folder(path.parent)
    if hasattr(os, "geteuid") and path.parent.stat().st_uid == os.geteuid():
        path.parent.chmod(0o700)  # it may be there already, and its files readable
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "w") as stream:
        stream.write(text + "\n")


def _create(path: Path) -> bytes:
    uid = secrets.token_bytes(UID_OCTETS)
    try:
        # Written to a temporary file and linked into place: two starts at once agree on one UID, and nobody reads half
        # a file.
        draft = path.with_name(f".{path.name}.{os.getpid()}")
        write_for_user_alone(draft, uid.hex())
        try:
            os.link(draft, path)
        except FileExistsError:
            return _parse_file(path, path.read_text())
        finally:
            draft.unlink()
    except OSError as error:
        raise ConfigError(f"cannot keep the part's UID in {path} ({error.strerror}): mend that or use --uid") from None
    return uid


def _parse_file(path: Path, text: str) -> bytes:
    try:
        return parse_uid(text.strip())
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}, or delete the file") from None


def _file_name(text: str) -> str:
    """The text with everything but letters, digits and a few signs written as %XX."""
    return "".join(
        character if character.isascii() and (character.isalnum() or character in "-_") else _escaped(character)
        for character in text
    )


def _escaped(character: str) -> str:
    return "".join(f"%{octet:02X}" for octet in character.encode())
