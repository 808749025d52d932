"""Keys: imported by parts that have one (docs/explain/security.md)."""

import hashlib
import struct

from .errors import ConfigError


def prove(key, nonce, uid, part_number, local_name, session_key):
    """The answer to a challenge: 16 octets of HMAC-SHA-256 (RFC 2104), see docs/explain/security.md."""
    return hmac(key, b"MsBOT claim 1\0" + claimed(nonce, uid, part_number, local_name, session_key))[:16]


def claimed(nonce, uid, part_number, local_name, session_key):
    """What a proof is about."""
    message = nonce + uid
    for text in (part_number.encode(), local_name.encode()):
        message += struct.pack(">H", len(text)) + text
    return message + struct.pack(">I", session_key)


def padded(key):
    """A key for the inner and for the outer hash."""
    key += bytes(64 - len(key))
    return bytes([octet ^ 0x36 for octet in key]), bytes([octet ^ 0x5C for octet in key])


def hmac(key, message):
    """HMAC-SHA-256."""
    inside, outside = padded(key)
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
        raise ConfigError("a key has 16 to 64 octets, this one has {}; `msbot key new` draws one".format(len(key)))
    return key
