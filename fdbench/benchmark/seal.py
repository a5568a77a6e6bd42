"""Sealed runs: the digests of all that is run are written down, then the nonce is drawn that the seeds follow from.

So no estimator that is run can have been made for these machines and disturbances. ``seal.json`` holds both; who has
the nonce can repeat every run. That the nonce was drawn once, and not until somebody liked the result, rests on the
word of who ran it: a board that matters is drawn by somebody who has no row on it.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from fdbench.documents import LARGEST_JSON, json_value, read_file
from fdbench.errors import FdbenchError, SpecError
from fdbench.files import VARIANT_NAME, write_text
from fdbench.nonce import check_nonce, new_nonce
from fdbench.specification import read

FILE = "seal.json"


@dataclass(frozen=True, kw_only=True)
class Seal:
    """What was fixed before the nonce was drawn, and the nonce.

    Attributes
    ----------
    estimators, scenarios : mapping of str to str
        Digest of each by name.
    code_digest, commit : str
        Of what simulates and scores.
    nonce : str
        Hexadecimal digits; empty as long as it is not drawn.
    """

    estimators: Mapping[str, str]
    scenarios: Mapping[str, str]
    code_digest: str
    commit: str
    nonce: str = ""


def sealed(folder: Path, fixed: Seal) -> Seal:
    """Write down what is fixed, draw the nonce, write it down too, and return both.

    A folder that is sealed already keeps its nonce, so that an interrupted run goes on.

    Raises
    ------
    FdbenchError
        If the folder is sealed for anything else.
    """
    present = read_seal(folder)
    if present is None:
        _write(folder, fixed)
        present = fixed
    for name in ("estimators", "scenarios", "code_digest"):
        if getattr(present, name) != getattr(fixed, name):
            raise FdbenchError(
                f"{folder / FILE}: sealed with other {name.replace('_', ' ')}. What was sealed must not change "
                "after its nonce was drawn; use a new folder."
            )
    if not present.nonce:
        present = replace(present, nonce=new_nonce())
        _write(folder, present)
    return present


def read_seal(folder: Path) -> Seal | None:
    """Return the seal of a folder of results, or None if it has none."""
    path = folder / FILE
    if not path.is_file():
        return None
    try:
        found = read(Seal, json_value(read_file(path, LARGEST_JSON)), "seal")
        if found.nonce:
            check_nonce(found.nonce)
        pairs = [*found.estimators.items(), *found.scenarios.items(), (found.code_digest, found.commit)]
        if not all(text == "" or VARIANT_NAME.fullmatch(text) for pair in pairs for text in pair):
            raise ValueError("names and digests are expected")
    except (OSError, ValueError, SpecError) as error:
        raise FdbenchError(f"{path}: not a seal ({error}).") from error
    return found


def _write(folder: Path, seal: Seal) -> None:
    write_text(folder / FILE, json.dumps(asdict(seal), indent=1) + "\n", folders=True)
