"""Evaluate: predict records with models in three ways, score every channel, and compare the models."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fdbench.diagnosis.evaluation import predictions
from fdbench.diagnosis.evaluation.effect_forces import is_followed
from fdbench.diagnosis.evaluation.predictions import Prediction
from fdbench.diagnosis.evaluation.result import ALL_RECORDS, WAYS, Evaluation, ModelComparison, PredictionScore, Ratio
from fdbench.diagnosis.evidence.prepare import check_alike, without_copies
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.model.replay import Replay, Variant
from fdbench.diagnosis.model.virtual_controller import prepared
from fdbench.diagnosis.records.encoder_clocks import encoder_clock_warnings
from fdbench.diagnosis.records.encoder_zeros import with_common_zeros
from fdbench.diagnosis.records.noise_model import NoiseModel, noise_floor
from fdbench.diagnosis.records.plausibility import check_alignment, check_record, clock_warnings
from fdbench.diagnosis.records.runs import RecordedRun, settling_time_s
from fdbench.diagnosis.settings import RECORDS
from fdbench.errors import RecordError, SpecError
from fdbench.record import FloatArray, Record
from fdbench.rotary import spoken_of, spoken_unit, spoken_words
from fdbench.units import unit_of

BLOCK_S = 0.25  # drawn whole, as errors of neighbouring samples are alike
RESAMPLES = 1000
SMALLEST = 1e-12


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluated:
    """An evaluation with the curves behind it.

    Attributes
    ----------
    evaluation : Evaluation
    runs : list of RecordedRun
        Of the records, as the first model sees them.
    predictions : mapping of (way, model) to list of Prediction
        One for each run.
    """

    evaluation: Evaluation
    runs: list[RecordedRun]
    predictions: Mapping[tuple[str, str], list[Prediction]]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Bench:
    """A model with the runs that it is evaluated on."""

    nominal: Nominal
    runs: list[RecordedRun]
    warnings: list[str]


def evaluate(models: Mapping[str, Nominal], records: Sequence[Record]) -> Evaluated:
    """Evaluate how well models predict records.

    Parameters
    ----------
    models : mapping of str to Nominal
        By the name that they have in tables.
    records : sequence of Record

    Raises
    ------
    RecordError
        If there are no records, or one lacks what is needed or cannot belong to a model; the message says what to do.
    SpecError
        If there is no model.
    """
    if not models:
        raise SpecError("no models: at least one is needed.")
    if not records:
        raise RecordError("no records: at least one is needed.")
    axes = {nominal.axis for nominal in models.values()}
    if len(axes) > 1:
        raise SpecError("models: some are of a linear axis, some of a rotary one.")
    with spoken_of(*axes):
        return _evaluated(models, next(iter(models.values())).on_the_arc(records))


def _evaluated(models: Mapping[str, Nominal], records: Sequence[Record]) -> Evaluated:
    records, _, copies = without_copies(records, [])
    benches = {name: _bench(nominal, records) for name, nominal in models.items()}
    band_Hz = min(
        predictions.useful_band_Hz(bench.nominal.drive, run) for bench in benches.values() for run in bench.runs
    )
    settling_s = max(settling_time_s(bench.nominal.drive) for bench in benches.values())
    warnings, found = list(copies), {}
    for name, bench in benches.items():
        drive = bench.nominal.drive
        replay = _replay(bench.nominal)
        closed = [predictions.closed_loop(replay, run) for run in bench.runs]
        said = [*bench.warnings, *_left_out(bench)]
        for run, own in zip(bench.runs, closed, strict=True):
            said += [*check_alignment(run, own.predicted), *clock_warnings(run, own.predicted)]
        said += encoder_clock_warnings(bench.runs, [own.predicted for own in closed])
        warnings += [line if len(models) == 1 else f"{name}: {line}" for line in said]
        # How the axis stood when the log began no model knows; all are compared on the same samples.
        before = (run.lead_in_samples(settling_s) for run in bench.runs)
        found["closed_loop", name] = [own.after(n) for own, n in zip(closed, before, strict=True)]
        loops = bench.nominal.simulation.cycles
        found["inverse_dynamics", name] = [
            predictions.inverse_dynamics(drive, run, band_Hz, loops) for run in bench.runs
        ]
        found["one_step_ahead", name] = [predictions.one_step_ahead(drive, run) for run in bench.runs]
    runs = next(iter(benches.values())).runs
    evaluation = Evaluation(
        models=tuple(models),
        records=tuple(run.name for run in runs),
        band_Hz=band_Hz,
        scores=tuple(score for way in WAYS for name in models for score in _scores(way, name, runs, found[way, name])),
        comparisons=tuple(_comparisons(list(models), runs, found)),
        warnings=tuple(map(spoken_words, dict.fromkeys(warnings))),
    )
    return Evaluated(evaluation=evaluation, runs=runs, predictions=found)


def _bench(nominal: Nominal, records: Sequence[Record]) -> _Bench:
    nominal, runs, warnings = prepared(nominal, records)
    check_alike(runs)
    for run in runs:
        check_record(run, nominal.drive)
    replay = _replay(nominal)
    runs, said = with_common_zeros(runs, replay.on_each(runs, Variant(plant=nominal.drive)))
    return _Bench(nominal=nominal, runs=runs, warnings=[*warnings, *said])


def _replay(nominal: Nominal) -> Replay:
    return Replay(nominal.drive, (), nominal.simulation.substeps, nominal.cycles)


def _left_out(bench: _Bench) -> list[str]:
    drive = bench.nominal.drive
    found = []
    if names := [item.name for item in drive.effects if not is_followed(item)]:
        found.append(
            f"Inverse dynamics and one step ahead are without {', '.join(names)} of the model, which a measured motion "
            "does not tell; the closed loop has all of it."
        )
    if drive.screw is not None and predictions.lumped(drive, bench.runs[0]).screw is None:
        found.append(
            "Only one side of the screw was measured: inverse dynamics and one step ahead see motor and table as one "
            "mass, which holds well below the first resonance only."
        )
    return found


# ---- scores ----


def _scores(way: str, model: str, runs: Sequence[RecordedRun], found: Sequence[Prediction]) -> list[PredictionScore]:
    shadows = [_shadow(run, own) for run, own in zip(runs, found, strict=True)]
    scores = []
    for channel in found[0].measured:
        floor = noise_floor(shadows, channel)
        groups = [(run.name, [own]) for run, own in zip(runs, found, strict=True)]
        groups += [(ALL_RECORDS, list(found))] if len(runs) > 1 else []
        scores += [_score(way, model, record, channel, own, floor) for record, own in groups]
    return scores


def _shadow(run: RecordedRun, found: Prediction) -> RecordedRun:
    """Return the run with errors in place of readings, so that repeats are compared by what the model leaves."""
    inside = slice(found.first, found.first + len(next(iter(found.measured.values()))))
    own, share = run.motion or (run.reference[:, 0], RECORDS.same_command)
    return dataclasses.replace(
        run,
        reference=run.reference[inside],
        channels=found.measured,
        left={name: values - found.predicted[name] for name, values in found.measured.items()},
        motion=(own[inside], share),
        given_force=None if run.given_force is None else run.given_force[inside],
    )


def _score(
    way: str, model: str, record: str, channel: str, found: Sequence[Prediction], floor: NoiseModel
) -> PredictionScore:
    errors = [own.measured[channel] - own.predicted[channel] for own in found]
    spreads = [own.measured[channel] - own.measured[channel].mean() for own in found]
    n = sum(len(error) for error in errors)
    square, spread = (sum(float(values @ values) for values in parts) for parts in (errors, spreads))
    relative = math.sqrt(square / spread) if spread > 0.0 else None
    return PredictionScore(
        way=way,
        model=model,
        record=record,
        channel=channel,
        unit=spoken_unit(unit_of(channel)),
        root_mean_square_error=math.sqrt(square / n),
        relative_error=relative,
        fit_percent=None if relative is None else 100.0 * (1.0 - relative),
        noise_floor=floor.total,
        noise_measured=floor.measured,
        samples=n,
    )


# ---- comparison ----


def _comparisons(
    models: Sequence[str], runs: Sequence[RecordedRun], found: Mapping[tuple[str, str], Sequence[Prediction]]
) -> list[ModelComparison]:
    if len(models) < 2:
        return []
    return [
        _comparison(way, channel, {name: _squares(found[way, name], channel, runs[0].period_s) for name in models})
        for way in WAYS
        for channel in found[way, models[0]][0].measured
    ]


def _squares(found: Sequence[Prediction], channel: str, period_s: float) -> FloatArray:
    """Return the squared error of each block of time of all records, (n_blocks,)."""
    length = max(1, round(BLOCK_S / period_s))
    squares = [(own.measured[channel] - own.predicted[channel]) ** 2 for own in found]
    return np.concatenate([np.add.reduceat(values, np.arange(0, len(values), length)) for values in squares])


def _comparison(way: str, channel: str, squares: Mapping[str, FloatArray]) -> ModelComparison:
    best = min(squares, key=lambda name: float(squares[name].sum()))
    n = len(squares[best])
    draws = np.random.default_rng(0).multinomial(n, np.full(n, 1.0 / n), size=RESAMPLES)
    ratios = []
    for name, own in squares.items():
        if name != best:
            low, high = np.percentile(
                _ratio(draws @ own, draws @ squares[best]), [2.5, 97.5], method="nearest"
            ).tolist()
            value = float(_ratio(own.sum(), squares[best].sum()))
            ratios.append(Ratio(model=name, value=value, ci95=(low, high)))
    certain = all(ratio.ci95[0] > 1.0 for ratio in ratios)
    return ModelComparison(way=way, channel=channel, best=best, ratios=tuple(ratios), certain=certain)


def _ratio(above: FloatArray | float, below: FloatArray | float) -> FloatArray:
    """Return the root of a ratio; two models without any error are alike."""
    return np.sqrt(np.maximum(above, SMALLEST**2) / np.maximum(below, SMALLEST**2))
