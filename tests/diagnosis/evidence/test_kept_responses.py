"""Products with kept responses are those of responses simulated anew, whatever was asked for before."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest
from search_lab import NOMINAL, search

from fdbench.diagnosis.evidence.evidence import Evidence, gather
from fdbench.diagnosis.evidence.run_to_run import Change
from fdbench.diagnosis.model.hypothesis import Hypothesis, start
from fdbench.diagnosis.model.replay import Replay, Replayed
from fdbench.diagnosis.search.refinement import Tangent
from fdbench.effects import effects


def are_alike(found: Evidence, expected: Evidence) -> None:
    scale = np.sqrt(expected.diagonal[:, :, None] * expected.diagonal[:, None])[:, : expected.products.shape[1]]
    np.testing.assert_allclose(found.products, expected.products, rtol=0.0, atol=1e-9 * scale.max())
    np.testing.assert_allclose(found.diagonal, expected.diagonal, rtol=1e-9)
    np.testing.assert_array_equal(found.lost, expected.lost)


@pytest.fixture
def simulated(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many lanes each call of the simulator had."""
    counts: list[int] = []
    fill = Replay.fill

    def counted(self: Replay, replayed: Sequence[Replayed]) -> None:
        counts.append(sum(len(item.variants) for item in replayed))
        fill(self, replayed)

    monkeypatch.setattr(Replay, "fill", counted)
    return counts


@pytest.mark.parametrize("whitened", [False, True])
def test_kept_responses_serve_other_gaps_and_beside_others(whitened: bool, simulated: list[int]) -> None:
    own = search()
    if whitened:
        run = own.split.runs[0]
        directions = np.linalg.qr(np.random.default_rng(3).standard_normal((run.n_samples, 2)))[0].T
        change = Change(directions=np.stack([directions] * len(run.channels), 1), shrinkage=np.array([0.9, 0.5]))
        own.refinement.look_at(
            own.readings, dataclasses.replace(own.split, changes=[change, *[None] * (len(own.split.runs) - 1)])
        )
    here = start(NOMINAL)
    beside = here.moved(0.3 * np.eye(len(here.shifts))[0])
    drag, cogging = (here.with_effect(effects.get(name).typical()) for name in ("quadratic_drag", "cogging"))
    tangent = Tangent.at(here)
    n, places = len(tangent.moved), [*own.split.fitted]

    def asked(
        base: Hypothesis,
        others: Sequence[Hypothesis],
        kept: int,
        common: int | None = None,
        chosen: slice = slice(None),
    ) -> None:
        """Gather with and without what is kept, and compare."""
        moved = tangent.moved[chosen]
        about = [here] * (len(moved) + len(others))
        anew = search()
        expected = gather(anew.readings, own.split, base, [*moved, *others], places, (), about, common)
        simulated.clear()
        found = gather(own.readings, own.split, base, [*moved, *others], places, (), about, common, kept=kept)
        are_alike(found, expected)

    asked(here, [], n)
    assert sum(simulated) == len(places) * (1 + n)
    asked(here, [], n)
    assert sum(simulated) == 0
    asked(beside, [], n)
    assert sum(simulated) == len(places)
    asked(beside, [drag], n + 1)
    assert sum(simulated) == len(places)
    asked(beside, [cogging], n)
    asked(here, [drag], n)
    asked(here, [cogging, drag], n, common=n + 1)
    asked(beside, [], n - 3, chosen=slice(1, n - 2))
    assert sum(simulated) == 0
    own.readings.forget([tangent.moved[1]])
    asked(here, [], n)
    assert sum(simulated) == len(places)


def test_a_kept_response_that_diverges_is_none() -> None:
    own, here = search(), start(NOMINAL)
    runaway = effects.get("structural_mode").typical(moving_mass_kg=60.0, natural_frequency_Hz=2000.0)
    variants = [here.moved_in_turn()[0], here.with_effect(runaway)]
    with np.errstate(over="ignore", invalid="ignore"):
        first, again = (gather(own.readings, own.split, here, variants, kept=2) for _ in range(2))
    for found in (first, again):
        np.testing.assert_array_equal(found.lost, [False, False, True])
        assert np.isfinite(found.products).all()
        assert not found.products[:, 2].any()


def test_responses_are_kept_where_forgotten_ones_were() -> None:
    own, here = search(), start(NOMINAL)
    moved, others = here.moved_in_turn(), [here.with_effect(effects.get("cogging").typical())]
    run, kept, every = own.split.runs[0], own.readings.responses[0], [(item.key, here.key) for item in moved]
    gather(own.readings, own.split, here, moved, [0], kept=len(moved))
    gather(own.readings, own.split, here, [*moved[:2], *others], [0], kept=3)
    (stretch,) = kept.stretches(every)
    assert not np.shares_memory(kept.room(run, len(moved))["position_m"], stretch.block["position_m"])
    own.readings.forget(moved[1:])
    assert not np.shares_memory(kept.room(run, len(moved))["position_m"], stretch.block["position_m"])
    own.readings.forget(moved[:1])
    few = kept.room(run, len(moved) // 3)  # there is far too much room for these
    assert not np.shares_memory(few["position_m"], stretch.block["position_m"])
    again = kept.room(run, len(moved) - 1)
    assert again["position_m"].shape == (len(moved) - 1, run.n_samples)
    assert np.shares_memory(again["position_m"], stretch.block["position_m"])
