"""Keys: how a part proves that its UID is its own, without revealing the key.

Theory of operation. A part and its robot share a secret of 16 octets or more, one for each UID. When the part claims,
the inventory sends a nonce that was never used before; the part answers with the first 16 octets of an HMAC-SHA-256
over everything in its claim, the nonce and the session. An eavesdropper learns nothing that is of use in another
session or for another challenge (RFC 2104, NIST SP 800-107: 128 bits of a truncated HMAC are ample; design PNP 2).

Every text is preceded by its length, so that no two different claims make the same octets.
"""

from __future__ import annotations

import hmac
import os
from pathlib import Path
from struct import Struct

from msbot.part.join.pnp_messages import NONCE_OCTETS, PROOF_OCTETS, SEALED_PROOF_OCTETS, UID_OCTETS
from msbot.part.join.uid import kept_file
from msbot_agent.text.untrusted_input import open_input_file
from msbot_xrce.errors import ConfigError

KEY_OCTETS = 16
"""Octets of a key that MsBOT generates, and of the shortest that it accepts."""
LONGEST_KEY = 64
"""Octets of the longest key that it accepts: one block of SHA-256."""
KEY_VARIABLE = "MSBOT_KEY"
MOST_READ = 4096
"""Octets of a file with a key; one has some forty digits and signs."""

_LABEL = b"MsBOT claim 1\0"
"""What the proof is for: a proof made for another purpose never fits."""
_SEALED_LABEL = b"MsBOT claim 2\0"
_SECRET_LABEL = b"MsBOT data 1\0"
_LENGTH = Struct(">H")
_SESSION = Struct(">I")


def prove(key: bytes, nonce: bytes, uid: bytes, *, part_number: str, local_name: str, session_key: int) -> bytes:
    """The answer to a challenge, 16 octets.

    Args:
        key: the part's key.
        nonce: the inventory's question, 16 octets.
        uid: 8 octets, as in the claim.
        part_number: as in the claim.
        local_name: as in the claim.
        session_key: the client key of the XRCE session in which the claim was made.
    """
    return _hmac(key, _LABEL, _claimed(nonce, uid, part_number, local_name, session_key))[:PROOF_OCTETS]


def prove_sealed(
    key: bytes, nonce: bytes, uid: bytes, *, part_number: str, local_name: str, session_key: int, session_nonce: int
) -> tuple[bytes, bytes]:
    """The answer to the challenge of a robot with sealed samples, 24 octets, and the secret for the seals.

    Args are those of `prove`, and `session_nonce`, as in the claim: thus each end contributes randomness to the secret.
    """
    claimed = _claimed(nonce, uid, part_number, local_name, session_key) + _SESSION.pack(session_nonce)
    return _hmac(key, _SEALED_LABEL, claimed)[:SEALED_PROOF_OCTETS], _hmac(key, _SECRET_LABEL, claimed)


def _claimed(nonce: bytes, uid: bytes, part_number: str, local_name: str, session_key: int) -> bytes:
    assert len(nonce) == NONCE_OCTETS
    assert len(uid) == UID_OCTETS
    texts = b"".join(_LENGTH.pack(len(octets)) + octets for octets in (part_number.encode(), local_name.encode()))
    return nonce + uid + texts + _SESSION.pack(session_key)


def _hmac(key: bytes, label: bytes, message: bytes) -> bytes:
    return hmac.digest(key, label + message, "sha256")


def is_same(proof: bytes, expected: bytes) -> bool:
    """Whether two proofs are the same, compared in constant time so that it does not reveal where they differ."""
    return hmac.compare_digest(proof, expected)


def check_key(key: bytes) -> bytes:
    """Refuse what cannot be a key.

    Raises:
        ConfigError: it does not have 16 to 64 octets.
    """
    if not KEY_OCTETS <= len(key) <= LONGEST_KEY:
        raise ConfigError(
            f"a key has {KEY_OCTETS} to {LONGEST_KEY} bytes, this one has {len(key)}; `msbot key new` draws one"
        )
    return key


def key_text(key: bytes) -> str:
    """A key as people write it: hexadecimal digits in groups of four."""
    digits = key.hex()
    return "-".join(digits[at : at + 4] for at in range(0, len(digits), 4))


def parse_key(text: str) -> bytes:
    """A key from hexadecimal digits; blanks, colons and dashes between them do not count.

    Raises:
        ConfigError: it is something else; the message does not repeat the text, which may be secret.
    """
    digits = text.translate(str.maketrans("", "", " :-\r\n\t"))
    try:
        key = bytes.fromhex(digits)
    except ValueError:
        raise ConfigError(
            f"that is not a key: write {2 * KEY_OCTETS} hexadecimal digits, as `msbot key new` shows them"
        ) from None
    return check_key(key)


def given_key(text: str | None, part_number: str, local_name: str) -> bytes | None:
    """The key that a user gave, as digits or as the name of a file with them; else the key file kept for that part;
    else None.

    Raises:
        ConfigError: what was found is not a key.
    """
    if text is None and (of_environment := os.environ.get(KEY_VARIABLE)):
        try:
            return given_key(of_environment, part_number, local_name)
        except ConfigError as error:
            raise ConfigError(f"${KEY_VARIABLE}: {error}") from None
    if text is None:
        path = kept_file("key", part_number, local_name)
        return _read(path) if path.exists() else None
    return _read(Path(text).expanduser()) if is_key_file(text) else parse_key(text)


def is_key_file(text: str) -> bool:
    """Whether a text that gives a key is the name of a file with it, not the key itself."""
    try:
        return Path(text).expanduser().is_file()
    except OSError:
        return False


def _read(path: Path) -> bytes:
    try:
        with open_input_file(path) as file:
            return parse_key((file.read(MOST_READ) or b"").decode("ascii", "replace"))
    except OSError as error:
        raise ConfigError(f"cannot read the part's key from {path}: {error.strerror}") from None
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None
