"""Preparation: records aligned with their model, split into what is fitted and what is judged on."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from fdbench.diagnosis.evidence.at_limit import told_at_limits
from fdbench.diagnosis.evidence.baseline import Baseline
from fdbench.diagnosis.evidence.force_out_of_step import without_forces_out_of_step
from fdbench.diagnosis.evidence.interpolation_artefact import (
    InterpolationError,
    interpolation_artefact,
    interpolation_error,
    waves,
)
from fdbench.diagnosis.evidence.run_to_run import Repeatability
from fdbench.diagnosis.evidence.sensor_artefacts import (
    Artefact,
    beside_known,
    grid_artefacts,
    held_artefact,
    interpolated,
    mean_energy,
    of_the_log,
    told_of,
)
from fdbench.diagnosis.evidence.split import Split
from fdbench.diagnosis.model.hypothesis import Hypothesis, start
from fdbench.diagnosis.model.nominal import Covered, Nominal
from fdbench.diagnosis.model.readings import Readings
from fdbench.diagnosis.model.replay import Replay
from fdbench.diagnosis.model.virtual_controller import prepared
from fdbench.diagnosis.records.asked_force import ForceScales
from fdbench.diagnosis.records.conditions import Apart, apart, restless
from fdbench.diagnosis.records.encoder_zeros import with_common_zeros
from fdbench.diagnosis.records.force_reading import limits_of_forces
from fdbench.diagnosis.records.noise_model import NoiseModel, noise_models, raised
from fdbench.diagnosis.records.plausibility import check_alignment, check_record
from fdbench.diagnosis.records.runs import (
    DEFLECTION,
    RecordedRun,
    after_lead_ins,
    merged,
    prepare,
    same_command,
    settling_time_s,
)
from fdbench.diagnosis.settings import EVIDENCE
from fdbench.errors import RecordError
from fdbench.plants.feed_drive import Following
from fdbench.record import FloatArray, Record
from fdbench.statistics import rms


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Aligned:
    """Records beside their model, before anything is explained.

    Attributes
    ----------
    nominal : Nominal
        As given, or with a virtual controller.
    runs : list of RecordedRun
        Of the records and then of the held-out ones, in one condition; samples that the logger held are bridged.
    n_fitted : int
        How many of the runs are of records that are not held out.
    readings : Readings
        Of the runs of the split, by the model at its own substeps.
    split : Split
    judged_on : str
    artefacts : list of Artefact
    others : list of Apart
        Runs of another condition, which are in none of the rest.
    unsteady : list of RecordedRun
        Those with a force that does not repeat with the motion.
    warnings, assumptions : list of str
        Of the warnings, those that say how the records are compared.
    """

    nominal: Nominal
    runs: list[RecordedRun]
    n_fitted: int
    readings: Readings
    split: Split
    judged_on: str
    artefacts: list[Artefact]
    others: list[Apart]
    unsteady: list[RecordedRun]
    warnings: list[str]
    assumptions: list[str]

    def assuming(self, text: str) -> "Aligned":
        """Return them with an assumption more."""
        return dataclasses.replace(self, warnings=[*self.warnings, text], assumptions=[*self.assumptions, text])

    def whole(self) -> "Aligned":
        """Return them with the means of repeats fitted and nothing judged on."""
        runs = merged(self.runs)
        held_out = [np.zeros(run.n_samples, dtype=np.bool_) for run in runs]
        split = Split(runs=runs, held_out=held_out, noise_models=self.split.noise_models)
        return dataclasses.replace(self, readings=Readings(self.readings.replay, runs), split=split)

    @property
    def only_unsteady(self) -> list[RecordedRun]:
        """Runs whose force does not repeat, but for those of another condition."""
        return [run for run in self.unsteady if all(run.reference is not item.run.reference for item in self.others)]


def aligned(
    nominal: Nominal,
    records: Sequence[Record],
    holdouts: Sequence[Record],
    baseline: Baseline | None = None,
    *,
    logged: bool = True,
) -> Aligned:
    """Return records as they are compared with their model; see `diagnose` for parameters and errors.

    What no logger wrote is not checked for damage, nor for being of this axis: a simulation without noise repeats
    itself to the last digit, and one with much noise hides its force.
    """
    if not records:
        raise RecordError("no records: at least one is needed, better three repeats of several motions.")
    records, holdouts = nominal.on_the_arc(records), nominal.on_the_arc(holdouts)
    records, holdouts, copies = without_copies(records, holdouts)
    nominal, runs, assumed = prepared(nominal, [*records, *holdouts], on_paper=baseline is None)
    check_alike(runs)
    for run in runs if logged else ():
        check_record(run.as_read(), nominal.drive)
    earlier = () if baseline is None else baseline.runs
    runs = after_lead_ins(runs, settling_time_s(nominal.drive), earlier)
    told = all("reference_velocity_m_per_s" in record for record in (*records, *holdouts))
    nominal, error = _as_recorded(nominal, runs, before=baseline is not None, velocity_told=told)
    drive = nominal.drive
    replay, given = _replay(nominal), start(nominal)
    as_read = [run.as_read() for run in runs]
    scales = ForceScales.of(as_read, drive, nominal.simulation.cycles)
    limits = [*limits_of_forces(as_read, drive), *told_at_limits(runs, drive)]
    warnings = [*copies, *assumed, *limits, *scales.warnings()]
    simulated = replay.on_each(runs, given.variant)
    runs, zeros = with_common_zeros(runs, simulated)
    beside = zip(runs, simulated, strict=True) if logged else ()
    said = [text for run, own in beside for text in check_alignment(run, own, unit_is_told=scales.tell_the_unit)]
    every = [_beside_model(run, own, baseline) for run, own in zip(runs, simulated, strict=True)]
    new = _not_before([item.run for item in every], baseline)
    warnings += [*zeros, *said, *new, *(text for item in every for text in item.warnings)]
    others = apart([item.run for item in every])
    fitted, judged = (
        [item for item in part if all(item.run is not other.run for other in others)]
        for part in (every[: len(records)], every[len(records) :])
    )
    if not fitted:
        fitted, judged = judged, []
    kept = [*fitted, *judged]
    out_of_step = without_forces_out_of_step([item.run for item in kept], nominal, replay)
    runs, warnings = out_of_step.runs, [*warnings, *out_of_step.warnings]
    split, judged_on = split_runs(runs[: len(fitted)], runs[len(fitted) :], noise_models(runs, nominal.way))
    if baseline is not None:
        split = dataclasses.replace(split, noise_models=baseline.noise(split.noise_models, split.runs))
    held = held_artefact([item.read for item in kept], [item.bridged for item in kept], [item.n_held for item in kept])
    artefacts = [item for item in (held, out_of_step.artefact) if item is not None]
    as_read = [run.as_read() for run in runs]
    grids = [of_the_log(item, split.noise_models) for item in grid_artefacts(as_read, replay, nominal.scale.length)]
    grids = [told_of(item, split.noise_models) for item in grids]
    for grid in [item for item in grids if mean_energy(item, split.noise_models) > EVIDENCE.smallest_artefact]:
        split = dataclasses.replace(split, noise_models=raised(split.noise_models, grid.energy))
        artefacts.append(grid)
    if error is not None:
        wave = interpolation_artefact(error, as_read, replay, split.noise_models)
        split = dataclasses.replace(split, noise_models=raised(split.noise_models, wave.energy))
        artefacts.append(wave)
    artefacts = [beside_known(artefact, drive) for artefact in artefacts]
    return Aligned(
        nominal=nominal,
        runs=runs,
        n_fitted=len(fitted),
        readings=Readings(replay, split.runs),
        split=split,
        judged_on=judged_on,
        artefacts=artefacts if baseline is None else [baseline.since(artefact) for artefact in artefacts],
        others=others,
        unsteady=[item.run for item in every if item.is_unsteady],
        warnings=warnings,
        # Of some motions it is how they are compared; where all are new, a baseline tells little.
        assumptions=[*assumed, *zeros, *(new if len(new) < len(every) else ())],
    )


def _as_recorded(
    nominal: Nominal, runs: Sequence[RecordedRun], *, before: bool, velocity_told: bool
) -> tuple[Nominal, InterpolationError | None]:
    """Return the model with what records cover of it, and the error of interpolation that their readings show."""
    covered = Covered(
        fastest_m_per_s=max(float(np.abs(run.reference[:, 1]).max()) for run in runs),
        longest_s=max(len(run.command) * run.period_s for run in runs),
        force_N=max(rms(run.channels["motor_force_N"]) for run in runs),
        period_s=runs[0].period_s,
        before=before,
        two_positions=DEFLECTION in runs[0].channels,
        velocity_told=velocity_told,
    )
    nominal = nominal.beside(covered)
    # A model that follows the measured motion follows its errors, too.
    follows = isinstance(nominal.drive.controller, Following)
    error = None if follows else interpolation_error([run.as_read() for run in runs], nominal)
    return nominal.beside(dataclasses.replace(covered, seen=waves(nominal.library))), error


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class _BesideModel:
    """A run as it was read, with the samples bridged that the logger held, and as it is compared with its model."""

    read: RecordedRun
    bridged: RecordedRun
    n_held: int
    run: RecordedRun
    is_unsteady: bool
    warnings: list[str]


def _beside_model(read: RecordedRun, as_nominal: Mapping[str, FloatArray], baseline: Baseline | None) -> _BesideModel:
    """Return a run beside what the nominal model has, less what a baseline has of it already."""
    warnings = []
    bridged, n_held = interpolated(read, as_nominal)
    run = bridged if baseline is None else baseline.corrected(bridged)
    is_unsteady = restless(run)
    if is_unsteady:
        run = dataclasses.replace(run, lap=None)
        warnings.append(
            f"{run.name}: its laps differ by more than a tenth of the force. A force acts that does not repeat "
            "with the motion; it is shown by itself, and what else is named was told beside it."
        )
    return _BesideModel(
        read=read,
        bridged=bridged,
        n_held=n_held,
        run=run.beside(as_nominal),
        is_unsteady=is_unsteady,
        warnings=warnings,
    )


def _not_before(runs: Sequence[RecordedRun], baseline: Baseline | None) -> list[str]:
    """Return what is said of runs whose command no record of a baseline has."""
    new = [run.name for run in runs if baseline is not None and baseline.of(run) is None]
    return [
        f"{name}: no baseline record has its command, so the error of the model's form does not cancel." for name in new
    ]


def without_copies(
    records: Sequence[Record], holdouts: Sequence[Record]
) -> tuple[list[Record], list[Record], list[str]]:
    """Return records and held-out ones without those that have the samples of one before them, and what to say."""
    found: tuple[list[Record], list[Record]] = ([], [])
    warnings = []
    for given, kept in zip((records, holdouts), found, strict=True):
        for record in given:
            first = next((other for other in (*found[0], *found[1]) if other == record), None)
            if first is None:
                kept.append(record)
            else:
                warnings.append(
                    f"{record.source}: a copy of {first.source}. It tells nothing of noise and is left out."
                )
    return *found, warnings


def with_run_to_run_covariance(
    replay: Replay, ready: Aligned, calibrated: Hypothesis, baseline: Baseline | None = None
) -> Split:
    """Return the split in which changes from run to run, about the re-calibrated model, are separated from noise.

    A floor that no repeats tell is assumed anew from what that model leaves: errors of the nominal parameters, which
    are in all that the nominal model leaves, are not in it.
    """
    runs = ready.runs
    if not ready.split.is_measured:
        simulated = replay.on_each(runs, calibrated.variant)
        runs = [run.beside(own) for run, own in zip(runs, simulated, strict=True)]
    found = Repeatability(replay, calibrated, runs)
    noise: Mapping[str, NoiseModel] = found.noise_models
    if baseline is not None:
        noise = baseline.noise(noise, ready.split.runs)
    for artefact in ready.artefacts:
        if not artefact.interpolated:
            noise = raised(noise, artefact.energy)
    changes = [found.change(run, noise) for run in ready.split.runs]
    return dataclasses.replace(ready.split, noise_models=noise, changes=changes)


def split_runs(
    records: Sequence[RecordedRun], holdouts: Sequence[RecordedRun], found: Mapping[str, NoiseModel]
) -> tuple[Split, str]:
    """Return what is fitted and what is judged on.

    With held-out records these are judged on; else the last of repeated records, else the last laps of records that
    repeat themselves, else the last third of each record.
    """
    if holdouts:
        fitted, judged = merged(records), merged(holdouts)
        masks = [np.zeros(run.n_samples, dtype=np.bool_) for run in fitted]
        masks += [np.ones(run.n_samples, dtype=np.bool_) for run in judged]
        return Split(runs=[*fitted, *judged], held_out=masks, noise_models=found), "held-out"
    last = [run for index, run in enumerate(records) if _is_last_repeat(records, index)]
    if last:
        return split_runs([run for run in records if run not in last], last, found)[0], "held-out repeats"
    masks = []
    for run in records:
        mask = np.zeros(run.n_samples, dtype=np.bool_)
        if run.lap is not None:
            laps = max(1, round(run.n_samples / run.lap * 0.5))
            mask[laps * run.lap :] = True
        else:
            mask[round(run.n_samples * (1.0 - EVIDENCE.held_out)) :] = True
        masks.append(mask)
    by = "held-out laps" if all(run.lap is not None for run in records) else "held-out last third of each record"
    return Split(runs=records, held_out=masks, noise_models=found), by


def _is_last_repeat(runs: Sequence[RecordedRun], index: int) -> bool:
    repeats_before = any(same_command(runs[index], other) for other in runs[:index])
    return repeats_before and not any(same_command(runs[index], other) for other in runs[index + 1 :])


def check_alike(runs: Sequence[RecordedRun]) -> None:
    """Raise a RecordError unless all runs have the same channels and clock."""
    first = runs[0]
    for run in runs[1:]:
        if set(run.channels) != set(first.channels):
            raise RecordError(
                f"{run.name}: channels {sorted(run.channels)} differ from those of {first.name}, "
                f"{sorted(first.channels)}; give records with the same columns."
            )
        if abs(run.period_s - first.period_s) > 1e-6 * first.period_s:
            raise RecordError(
                f"{run.name}: sampled every {run.period_s:g} s, {first.name} every {first.period_s:g} s; "
                "give records with one clock."
            )


def merged_runs(nominal: Nominal, records: Sequence[Record], holdouts: Sequence[Record]) -> tuple[Readings, Split]:
    """Return the readings of a model and its runs, repeats merged, as they are without a look at their readings."""
    groups = (nominal.on_the_arc(group) for group in (records, holdouts))
    runs, others = ([prepare(item, nominal.drive) for item in group] for group in groups)
    split, _ = split_runs(runs, others, noise_models([*runs, *others], nominal.way))
    replay = _replay(nominal)
    return Readings(replay, split.runs).coarsened(start(nominal), split.noise_models), split


def _replay(nominal: Nominal) -> Replay:
    return Replay(nominal.drive, nominal.library, nominal.simulation.substeps, nominal.cycles)
