"""Sealing: commitments that bind who makes a trial and who answers it, without telling one what the other knows."""

import hashlib
import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

from fdbench.documents import LARGEST_JSON, check_is_file, json_value, read_file
from fdbench.errors import SpecError
from fdbench.files import write_text
from fdbench.nonce import derived

LARGEST_DIGEST = 4096  # bytes of a file that holds one


def generator(nonce: str, label: str) -> np.random.Generator:
    """Return the random generator of a label."""
    return np.random.default_rng(int.from_bytes(derived(nonce, f"seed of {label}"), "big"))


def salt(nonce: str, case: str) -> str:
    """Return the salt of a case's truth."""
    return derived(nonce, f"salt of {case}").hex()


def canonical(truth: Any) -> bytes:
    """Return a JSON value as bytes that do not depend on the order or the layout in which it was written.

    >>> canonical({"b": 1.0, "a": [True, None]})
    b'{"a":[true,null],"b":1.0}'
    """
    return json.dumps(truth, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode()


def commitment(salt_hex: str, truth: Any) -> str:
    """Return SHA-256 of the salt followed by the canonical truth, in hexadecimal digits."""
    return hashlib.sha256(bytes.fromhex(salt_hex) + canonical(truth)).hexdigest()


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal digits.

    Raises
    ------
    SpecError
        If it cannot be read.
    """
    try:
        check_is_file(path)
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise SpecError(f"{path}: cannot be read: {error.strerror}.") from error
    except ValueError as error:
        raise SpecError(f"{path}: cannot be read: {error}.") from error


def write_digest(path: Path) -> str:
    """Write the SHA-256 of a file beside it as ``<stem>.sha256``, in the form of sha256sum, and return it."""
    digest = file_digest(path)
    write_text(path.with_suffix(".sha256"), f"{digest}  {path.name}\n", SpecError)
    return digest


def check_digest(path: Path) -> None:
    """Raise a SpecError unless a file is the one whose SHA-256 lies beside it."""
    beside = path.with_suffix(".sha256")
    if not beside.is_file():
        raise SpecError(f"{path}: no {beside.name} beside it; `fdbench trial answer` writes both.")
    try:
        sealed = read_file(beside, LARGEST_DIGEST).split()[:1]
    except (OSError, ValueError) as error:
        raise SpecError(f"{beside}: cannot be read: {error}.") from error
    if sealed != [file_digest(path).encode()]:
        raise SpecError(f"{path}: changed since it was handed in; its SHA-256 is not that of {beside.name}.")


def write_json(path: Path, content: Any) -> None:
    """Write a JSON file; what was there before stays until all of it is written.

    Raises
    ------
    SpecError
        If it cannot be written.
    """
    write_text(path, json.dumps(content, indent=1, ensure_ascii=False) + "\n", SpecError, folders=True)


def read_json(path: Path, what: str) -> Any:
    """Return the content of a JSON file.

    Raises
    ------
    SpecError
        If it cannot be read or is no JSON object; ``what`` says what was expected.
    """
    try:
        content = json_value(read_file(path, LARGEST_JSON))
    except OSError as error:
        raise SpecError(f"{path}: {what} cannot be read: {error.strerror}.") from error
    except ValueError as error:
        raise SpecError(f"{path}: {what} is not JSON: {error}.") from error
    if not isinstance(content, dict):
        raise SpecError(f"{path}: {what} is not a JSON object.")
    return content


def code_digest() -> str:
    """Return the SHA-256 of the package's Python and TOML files, which says what ran where a commit does not."""
    root = Path(__file__).parents[1]
    total = hashlib.sha256()
    for path in sorted(path for path in root.rglob("*") if path.suffix in (".py", ".toml")):
        total.update(hashlib.sha256(path.read_bytes()).digest())
    return total.hexdigest()


def code_commit() -> str:
    """Return the git commit of the code, ``-dirty`` with changes, or an empty text outside a checkout."""
    try:
        return _git("describe", "--always", "--dirty", "--abbrev=40", "--exclude=*") if _git("ls-files") else ""
    except (OSError, subprocess.SubprocessError):
        return ""


def _git(*arguments: str) -> str:
    folder = Path(__file__).parents[1]
    done = subprocess.run(["git", *arguments], cwd=folder, capture_output=True, text=True, timeout=20, check=True)
    return done.stdout.strip()
