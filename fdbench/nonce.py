"""Secrets that nobody could know before they were drawn, and what follows from them."""

import hashlib
import hmac
import re
import secrets

from fdbench.errors import SpecError

NONCE_BYTES = 32


def new_nonce() -> str:
    """Return a secret that nobody could know before, 64 hexadecimal digits."""
    return secrets.token_hex(NONCE_BYTES)


def check_nonce(nonce: str) -> str:
    """Return a nonce as it is used, or raise a SpecError if it is none."""
    text = nonce.lower()
    if not re.fullmatch(r"[0-9a-f]{16,128}", text) or len(text) % 2:
        raise SpecError(f"nonce: '{nonce}' is not an even number of 16 to 128 hexadecimal digits.")
    return text


def derived(nonce: str, label: str) -> bytes:
    """Return 32 bytes that follow from a nonce and a label, and tell nothing of either.

    >>> derived("00" * 8, "a") == derived("00" * 8, "a"), derived("00" * 8, "a") == derived("00" * 8, "b")
    (True, False)
    """
    return hmac.new(bytes.fromhex(nonce), label.encode(), hashlib.sha256).digest()


def derived_seed(nonce: str, scenario: str, seed: int) -> int:
    """Return what the random streams of one run start from: the seed itself, or with a nonce 62 bits that hide it.

    >>> derived_seed("", "ShakerConstant-v1", 3)
    3
    """
    return seed if nonce == "" else int.from_bytes(derived(nonce, f"{scenario} {seed}")[:8], "big") >> 2
