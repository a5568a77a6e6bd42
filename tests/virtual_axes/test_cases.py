"""What is injected shows by itself, whatever traces of other effects a machine has."""

import numpy as np
import pytest

from fdbench.trials.make import listed_effects
from fdbench.virtual_axes.bench import Detectability
from fdbench.virtual_axes.cases import Tier, inject
from fdbench.virtual_axes.foreign.bench import ForeignBench
from fdbench.virtual_axes.foreign.kinds import kinds, space_of
from fdbench.virtual_axes.foreign.motions import RECIPES


def test_traces_make_no_effect_visible(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside traces that alone are far above the noise, what is injected is as large as on a machine without."""
    kind = next(kind for kind in kinds() if kind.name == "linear_stage")
    sides = ("motor_position_m",)

    def add_much(bench: ForeignBench, detectability: Detectability, rng: np.random.Generator) -> None:
        bench.background = {"cogging": bench.draw("cogging", rng)}

    monkeypatch.setattr(ForeignBench, "add_background", add_much)
    for seed in range(6):
        rng = np.random.default_rng(seed)
        bench = ForeignBench(kind, Tier.G, rng)
        motions = [RECIPES[name](space_of(kind, bench.value), rng) for name in kind.motions]
        injected, sizes = inject(bench, (1, 0), listed_effects(), motions, sides, rng)
        ((name, drawn),) = injected.items()
        clean = bench.without_background()
        alone = Detectability(clean, motions, sides, rng).mean_square(
            clean.axis({name: drawn}), not clean.is_nominal_parameter(name)
        )
        assert sizes[name] == pytest.approx(alone, rel=0.5), name
