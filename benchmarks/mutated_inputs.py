"""Give mutated files of every kind that users feed in to the functions behind the commands.

Prints how they ended for each kind of file, then each kind of defect once, and exits with 1 where there is one; what is
mutated, and what counts as a defect, is in ``tests/mutations``, which runs a short form of it.
"""

import argparse
import resource
import shutil
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

MEMORY = 8 * 2**30  # bytes beyond what is in use


def main(arguments: Sequence[str] | None = None) -> int:
    """Attack, print the table and each kind of defect once, and return the exit code."""
    from mutations.attack import DEFECTS, Tally, attack, table
    from mutations.targets import TARGETS

    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=1000, help="mutations for each row")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="*", default=None, help="rows, by parts of their names")
    parser.add_argument("--keep", type=Path, default=None, help="folder for the inputs of defects")
    given = parser.parse_args(arguments)
    in_use = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (in_use + MEMORY, resource.getrlimit(resource.RLIMIT_AS)[1]))
    chosen = [target for target in TARGETS if given.only is None or any(part in target.name for part in given.only)]
    tallies: dict[str, Tally] = {}
    with tempfile.TemporaryDirectory() as place:
        for target in chosen:
            start = time.perf_counter()
            tallies[target.name] = attack(target, given.count, given.seed, Path(place) / str(len(tallies)), given.keep)
            shutil.rmtree(Path(place) / str(len(tallies) - 1))
            print(
                f"{target.name}: {dict(tallies[target.name].counts)}, {time.perf_counter() - start:.0f} s",
                file=sys.stderr,
            )
    print(table(tallies))
    seen = set()
    for tally in tallies.values():
        for defect in tally.defects:
            last = [line for line in defect.splitlines() if line.strip()][-3:]
            if tuple(last) not in seen:
                seen.add(tuple(last))
                print(f"\n{defect[-1800:]}")
    return int(any(tally.counts[outcome] for tally in tallies.values() for outcome in DEFECTS))


if __name__ == "__main__":
    sys.exit(main())
