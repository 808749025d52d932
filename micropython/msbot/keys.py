"""Keys: imported for a proof, and forgotten again (docs/explain/security.md)."""

import hashlib
import struct

from .errors import ConfigError


def prove(key, nonce, uid, part_number, local_name, session_key):
    """The answer to a challenge: 16 octets of HMAC-SHA-256 (RFC 2104), see docs/explain/security.md."""
    return _hmac(key, b"MsBOT claim 1\0" + _claimed(nonce, uid, part_number, local_name, session_key))[:16]


def prove_sealed(key, nonce, uid, part_number, local_name, session_key, session_nonce):
    """The proof, 24 octets, in a robot with sealed samples, and the pads of both directions' seals."""
    message = _claimed(nonce, uid, part_number, local_name, session_key) + struct.pack(">I", session_nonce)
    secret = _hmac(key, b"MsBOT data 1\0" + message)
    # Padded once, so that a sample costs only two hashes.
    pads = [_padded(_hmac(secret, way)) for way in (b"MsBOT from the part\0", b"MsBOT to the part\0")]
    return _hmac(key, b"MsBOT claim 2\0" + message)[:24], pads


def _claimed(nonce, uid, part_number, local_name, session_key):
    message = nonce + uid
    for text in (part_number.encode(), local_name.encode()):
        message += struct.pack(">H", len(text)) + text
    return message + struct.pack(">I", session_key)


def _padded(key):
    key += bytes(64 - len(key))
    return bytes([octet ^ 0x36 for octet in key]), bytes([octet ^ 0x5C for octet in key])


def _hmac(key, message):
    inside, outside = _padded(key)
    return hashlib.sha256(outside + hashlib.sha256(inside + message).digest()).digest()


def parse_key(key):
    """The octets of a key; as text it is hexadecimal, as `msbot key new` writes it."""
    if isinstance(key, str):
        digits = "".join([c for c in key if c not in " :-\r\n\t"])
        try:
            key = bytes.fromhex(digits)
        except ValueError:
            words = "that is not a key: write 32 hexadecimal digits, as `msbot key new` shows them"
            raise ConfigError(words) from None
    if not 16 <= len(key) <= 64:
        raise ConfigError("a key has 16 to 64 bytes, this one has {}; `msbot key new` draws one".format(len(key)))
    return key
