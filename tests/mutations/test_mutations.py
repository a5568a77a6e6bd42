"""A short form of ``benchmarks/mutated_inputs.py``: no mutation ends in a traceback, a hang or wrong numbers."""

from pathlib import Path

import pytest

from mutations.attack import attack
from mutations.mutate import MUTATIONS, mutated
from mutations.targets import TARGETS

COUNT = 30

# Those that are quick; logs, results and trials take the time of packages that read them, simulations and bootstraps.
QUICK = ("records", "mappings", "models", "scenarios", "answers as JSON", "what was kept")


@pytest.mark.parametrize("name", QUICK)
def test_mutated_files_are_read_or_refused(name: str, tmp_path: Path) -> None:
    (target,) = (target for target in TARGETS if target.name == name)
    tally = attack(target, COUNT, 0, tmp_path / "files")
    assert tally.defects == []
    assert tally.counts.total() == COUNT
    assert tally.counts["refused"] > tally.counts["accepted"] > 0


def test_a_seed_gives_the_same_mutations() -> None:
    import numpy as np

    def some(seed: int) -> list[tuple[str, bytes]]:
        return [mutated(b"a = 1\nb = 2.5\n", np.random.default_rng([seed, number])) for number in range(300)]

    assert some(1) == some(1) != some(2)
    assert {kind for kind, _ in some(1)} == set(MUTATIONS)
