"""What a score is made by: what only uses scores changes no digest, and takes no part in making them."""

import subprocess
import sys

from fdbench.benchmark.provenance import PACKAGE, USERS_OF_SCORES

WORK = """
import sys
import fdbench
before = set(sys.modules)
import fdbench.benchmark.job
from fdbench.scenario import load_scenario
for name in ("ShakerConstant-v0", "SpindleTestbedForce-v0", "SlotMilling-v0"):
    load_scenario(name).observe(0)
print(*(name for name in sys.modules if name.startswith("fdbench.") and name not in before))
"""


def test_users_of_scores_have_no_part_in_making_them() -> None:
    done = subprocess.run([sys.executable, "-c", WORK], capture_output=True, text=True, check=True)
    loaded = {name.removeprefix("fdbench.").replace(".", "/") + "/" for name in done.stdout.split()}
    assert {"simulate/axis/", "plants/feed_drive/"} <= loaded
    users = tuple(name.removesuffix(".py") for name in USERS_OF_SCORES)
    assert {name for name in loaded if name.startswith(users)} == set()


def test_users_of_scores_are_there() -> None:
    files = [path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*") if path.is_file()]
    assert [name for name in USERS_OF_SCORES if not any(file.startswith(name) for file in files)] == []
