"""Diagnose: prepare records, re-calibrate, search, judge, propose an experiment; the answer of all that."""

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from fdbench.diagnosis.answer.answer import Answer
from fdbench.diagnosis.answer.quantity import Quantity
from fdbench.diagnosis.answer.recorded import Recorded
from fdbench.diagnosis.evidence.at_limit import without_limited_controller
from fdbench.diagnosis.evidence.baseline import Baseline
from fdbench.diagnosis.evidence.evidence import gather, with_explained
from fdbench.diagnosis.evidence.prepare import Aligned, aligned, with_run_to_run_covariance
from fdbench.diagnosis.evidence.sensor_artefacts import mean_energy
from fdbench.diagnosis.evidence.split import Split
from fdbench.diagnosis.experiment.expected_information import Forecast, VerdictReader
from fdbench.diagnosis.experiment.proposal import design
from fdbench.diagnosis.judge import probability_models
from fdbench.diagnosis.judge.cause_sets import cause_set
from fdbench.diagnosis.judge.cause_types import cause_types
from fdbench.diagnosis.judge.false_alarms import false_alarms
from fdbench.diagnosis.judge.findings import Findings
from fdbench.diagnosis.judge.gap import gap_of, noise_floor
from fdbench.diagnosis.judge.localise import Gaps, where
from fdbench.diagnosis.judge.nameless_values import nameless_warnings
from fdbench.diagnosis.judge.probability_models import Features, ProbabilityModels
from fdbench.diagnosis.judge.process_force import process_forces, unsteady_forces
from fdbench.diagnosis.judge.reduction import Reductions, channel_gaps, parametric, reductions_of, shrinkage
from fdbench.diagnosis.judge.residual_dependence import dependences
from fdbench.diagnosis.judge.verdict import Verdict, verdict
from fdbench.diagnosis.model.as_nominal import as_nominal
from fdbench.diagnosis.model.hypothesis import Hypothesis, start
from fdbench.diagnosis.model.nominal import Nominal, Simulation, Uncertainty
from fdbench.diagnosis.model.rotary_axis import record_of_rotary
from fdbench.diagnosis.records.plausibility import clock_warnings
from fdbench.diagnosis.records.runs import FORCE
from fdbench.diagnosis.search.beside_the_known import beside_the_known
from fdbench.diagnosis.search.calibrated import Calibrated
from fdbench.diagnosis.search.command_rates import with_likely_rates
from fdbench.diagnosis.search.in_place_of_a_value import in_place_of_a_value
from fdbench.diagnosis.search.loop_rate import at_likely_rate
from fdbench.diagnosis.search.refinement import Refinement
from fdbench.diagnosis.search.search import Search
from fdbench.diagnosis.search.set_anew import gains_set_anew, with_gains
from fdbench.diagnosis.search.stage import Stage
from fdbench.diagnosis.search.sticking import that_sticks
from fdbench.diagnosis.settings import BASELINE, EVIDENCE
from fdbench.effects import Effect
from fdbench.record import FloatArray, Record
from fdbench.rotary import LINEAR, spoken_of, spoken_unit, spoken_words
from fdbench.units import unit_of

# What no calibration on other motions tells: the form of friction, and how late a loop is.
OF_FORM = (
    *("transition_velocity", "bristle_form", "friction_side", "friction_form"),
    *("velocity_filter", "reference_delay", "loop_lag"),
)


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Diagnosis:
    """What was found: the answer, and the hypotheses behind it for whoever wants to go on.

    Attributes
    ----------
    answer : Answer
    asked : Nominal
        The model as it was given, with its controller.
    calibrated, final : Hypothesis
        Without and with the named effects.
    stages : list of Stage
    split : Split
    simulated, repaired : list of mappings
        Channels of each run as the re-calibrated model without effects and the final model have them.
    forecast : Forecast or None
        Of the next experiment.
    features : mapping
        What the probabilities are predicted from; see `fdbench.diagnosis.judge.verdict.Verdict`.
    """

    answer: Answer
    asked: Nominal
    calibrated: Hypothesis
    final: Hypothesis
    stages: list[Stage]
    split: Split
    simulated: list[Mapping[str, FloatArray]]
    repaired: list[Mapping[str, FloatArray]]
    forecast: Forecast | None
    features: Mapping[str, Mapping[str, Features]]


@contextmanager
def _diagnosing(axis: str) -> Iterator[None]:
    """Speak of an axis; what diverges may overflow, and threads of BLAS, which only wait on small matrices, are one."""
    quietly = np.errstate(over="ignore", invalid="ignore")
    with quietly, threadpool_limits(1, user_api="blas"), spoken_of(axis):
        yield


def diagnose(
    nominal: Nominal,
    records: Sequence[Record],
    holdouts: Sequence[Record] = (),
    progress: Callable[[str], None] | None = None,
    models: ProbabilityModels | None = None,
    baseline: Sequence[Record] = (),
) -> Diagnosis:
    """Diagnose the gap between a nominal model and records of the real axis.

    Parameters
    ----------
    nominal : Nominal
    records, holdouts : sequences of Record
        Fitted on, and judged on.
    progress : callable, optional
    models : ProbabilityModels, optional
        Predict the probabilities; without, those that the package is shipped with.
    baseline : sequence of Record, optional
        Of the same machine before. The model is calibrated on them first, and causes are of what has changed since.

    Raises
    ------
    RecordError
        If there are no records, or one lacks what is needed; the message says what to do.
    """
    with _diagnosing(nominal.axis):
        return _diagnosed(nominal, records, holdouts, progress, models, baseline)


def _diagnosed(
    nominal: Nominal,
    records: Sequence[Record],
    holdouts: Sequence[Record],
    progress: Callable[[str], None] | None,
    models: ProbabilityModels | None,
    baseline: Sequence[Record],
) -> Diagnosis:
    healthy, asked = None, nominal
    if baseline:
        begun, healthy = _since(nominal, records, holdouts, baseline, progress)
    else:
        begun = _on_paper(nominal, records, holdouts, progress)
    found = _searched(begun, progress, healthy)
    ready, given, findings = found.ready, found.given, found.findings
    nominal, search, reductions, final = ready.nominal, findings.search, findings.reductions, findings.final
    readings, split, drive = search.readings, search.split, nominal.drive
    places = range(len(split.runs))
    simulated = [[readings.alone(place, item) for place in places] for item in (given, found.calibrated, final)]
    raw = float(findings.as_given.mean())
    models = models or probability_models.models()
    said = verdict(findings, models)
    reader = VerdictReader(models=models, unknown=said.unknown_probability, worst=said.worst, settled=said.settled())
    forecast = design(readings, split, [*_worth_telling(findings, said), *findings.stages[-1:]], nominal, reader)
    rest = dependences(split.plain, simulated[2], drive)
    answer = Answer(
        gap=gap_of(split, simulated),
        where=where(Gaps.of(split.plain, simulated[1])),
        causes=said.causes,
        suspects=said.suspects,
        unknown_probability=said.unknown_probability,
        no_gap_probability=said.no_gap_probability,
        probabilities_from=models.source,
        nearest=said.nearest,
        types=cause_types(said.causes, said.suspects, said.unknown_probability, rest, drive),
        rest_depends_on=rest,
        shrinkage=shrinkage(
            reductions, findings.shown_by, final, findings.artefacts, split.plain, ready.judged_on, raw
        ),
        next_experiment=None if forecast is None else forecast.experiment(),
        warnings=tuple(map(spoken_words, ready.warnings)),
        assumptions=tuple(map(spoken_words, ready.assumptions)),
        parametric=parametric(raw, reductions, found.calibrated, final, {} if healthy is None else healthy.set_anew),
        noise_floor={
            name: noise_floor(floor, spoken_unit(unit_of(name)), split.runs[0].period_s)
            for name, floor in split.noise_models.items()
        },
        process_forces=(
            *process_forces(ready.others, readings, final),
            *unsteady_forces(ready.only_unsteady, readings.replay, given),
        ),
        recorded=Recorded(
            records=sum(run.repeats for run in split.runs),
            samples=sum(run.repeats * len(run.command) for run in split.runs),
            sampling_time_s=split.runs[0].period_s,
            baseline=len(baseline),
            force=Quantity(value=_force_rms_N(split), ci95=None, unit=spoken_unit("N")),
        ),
        false_alarms=None if baseline else false_alarms(said.surest(), said.unknown_probability),
        cause_set=None if baseline else cause_set(said.chances(), said.unknown_probability, alike=said.alike()),
        axis=nominal.axis,
    )
    return Diagnosis(
        answer=answer,
        asked=asked,
        calibrated=found.calibrated,
        final=final,
        stages=[*findings.stages],
        split=split,
        simulated=simulated[1],
        repaired=simulated[2],
        forecast=forecast,
        features=said.features,
    )


def _worth_telling(findings: Findings, said: Verdict) -> list[Stage]:
    """Return the contests of effects that may be a cause, however they turn out."""
    none = {cause.effect for cause in said.causes if cause.within_known}
    pairs = zip(findings.final.effects, findings.contests, strict=True)
    return [contest for effect, contest in pairs if effect.name not in none]


def _force_rms_N(split: Split) -> float:
    squares = [float(np.sum(np.square(run.as_read().channels[FORCE]))) for run in split.runs]
    return math.sqrt(sum(squares) / max(sum(run.n_samples for run in split.runs), 1))


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class _Searched:
    """What a search found, before anything is said of it."""

    ready: Aligned
    given: Hypothesis
    calibrated: Hypothesis
    findings: Findings


def _on_paper(
    nominal: Nominal,
    records: Sequence[Record],
    holdouts: Sequence[Record],
    progress: Callable[[str], None] | None = None,
) -> Calibrated:
    """Return a model as it is on paper re-calibrated on records, at the rates that are likely."""
    nominal, told = without_limited_controller(nominal, [*records, *holdouts])

    def anew(simulation: Simulation) -> Aligned:
        return aligned(dataclasses.replace(nominal, simulation=simulation), records, holdouts)

    def beside(known: Sequence[Effect]) -> Aligned:
        simulation = found.ready.nominal.simulation
        return aligned(dataclasses.replace(nominal.knowing(known), simulation=simulation), records, holdouts)

    ready = aligned(nominal, records, holdouts)
    _say(progress, "re-calibrating the nominal parameters")
    found = at_likely_rate(with_likely_rates(Calibrated.of(ready), anew), anew)
    return _told(that_sticks(found, beside), told)


def _since(
    nominal: Nominal,
    records: Sequence[Record],
    holdouts: Sequence[Record],
    baseline: Sequence[Record],
    progress: Callable[[str], None] | None,
) -> tuple[Calibrated, Baseline]:
    """Return a model that was calibrated on a baseline re-calibrated on records, and that baseline.

    What the model's form gets wrong cancels, its rates with it. Gains that were set anew are known from then on.
    """
    nominal, told = without_limited_controller(nominal, [*baseline, *records, *holdouts])
    known, healthy = calibrated_on(nominal, baseline, progress)
    told = [*told, *healthy.said]
    ready = aligned(known, records, holdouts, healthy)
    if not healthy.covers(ready.runs):
        # Without records of the same command before, an error of the model's form does not cancel.
        doubt = {name: getattr(nominal.uncertainty, name) for name in OF_FORM}
        known = dataclasses.replace(known, uncertainty=dataclasses.replace(known.uncertainty, **doubt))
        ready = aligned(known, records, holdouts, healthy)
    _say(progress, "re-calibrating the nominal parameters")
    found = Calibrated.of(ready, narrow=True)
    gains = gains_set_anew(found)
    if gains:
        healthy = dataclasses.replace(healthy, set_anew=gains)
        found = Calibrated.of(aligned(with_gains(known, gains), records, holdouts, healthy), narrow=True)
    return _told(found, told), healthy


def _told(found: Calibrated, first: Sequence[str]) -> Calibrated:
    """Return a re-calibrated model with what is to be told first."""
    ready = found.ready
    warnings, assumptions = [*first, *ready.warnings], [*first, *ready.assumptions]
    return dataclasses.replace(found, ready=dataclasses.replace(ready, warnings=warnings, assumptions=assumptions))


def _say(progress: Callable[[str], None] | None, text: str) -> None:
    if progress is not None:
        progress(text)


def _searched(
    found: Calibrated, progress: Callable[[str], None] | None = None, healthy: Baseline | None = None
) -> _Searched:
    ready, refinement, calibrated = found.ready, found.refinement, found.hypothesis
    search, given = Search(refinement, progress), start(ready.nominal)
    split = with_run_to_run_covariance(refinement.readings.replay, ready, calibrated, healthy)
    refinement.look_at(ready.readings.coarsened(given, split.noise_models), split)
    base = refinement.refine(calibrated)
    refinement.look_at(refinement.readings, with_explained(split, gather(refinement.readings, split, base, ())))
    final, stages = search.run(base)
    sought, contests = search.review(final, stages)
    # The search weighs what friction may do in each run; what is judged, drawn and written is one model for all.
    readings, plain = search.readings, search.split.plain
    last = Refinement(readings, plain, refinement.nominal)
    refinement.nominal = last.nominal  # what is simulated about the last model serves its intervals
    weighed = last.refine(sought) if sought.effects else calibrated
    calibrated = last.refine(calibrated, tempered=False)
    exchange = in_place_of_a_value(Search(last), weighed, stages[-1], calibrated) if stages else None
    if exchange is not None and exchange.log_odds > 0.0:
        contests = contests if weighed.has(exchange.kind) else [*contests, stages[-1]]
        weighed = exchange.hypothesis
    simulated = readings.replay.on_each(ready.runs, calibrated.variant)
    clocks = [text for run, own in zip(ready.runs, simulated, strict=True) for text in clock_warnings(run, own)]
    held = () if exchange is None or exchange.hypothesis is not weighed else exchange.held
    final = last.predicting_best(weighed, calibrated, held).as_it_acts() if weighed.effects else calibrated
    ready = dataclasses.replace(ready, warnings=[*ready.warnings, *clocks, *nameless_warnings(final)])
    reductions = reductions_of(readings, plain, calibrated, final)
    findings = Findings(
        search=search,
        as_given=channel_gaps(readings, plain, [given])[0],
        where_fitted=channel_gaps(readings, plain, [calibrated], held_out=False)[0],
        calibrated=calibrated,
        base=base,
        sought=sought,
        final=final,
        weighed=weighed,
        stages=stages,
        contests=contests,
        exchange=exchange,
        remainder=beside_the_known(Search(last), weighed),
        reductions=reductions,
        beside_changes=_beside_changes(reductions, search, base, sought) if exchange is None else None,
        artefacts=[
            artefact
            for artefact in ready.artefacts
            if mean_energy(artefact, plain.noise_models) > EVIDENCE.smallest_artefact
        ],
    )
    return _Searched(ready=ready, given=given, calibrated=calibrated, findings=findings)


def _beside_changes(reductions: Reductions, search: Search, base: Hypothesis, sought: Hypothesis) -> Reductions | None:
    """Return what effects leave beside what friction may change by from run to run, where that may hide one of them.

    One model for all runs is then worse with it by less than the noise, which that is a part of.
    """
    may_hide = any(map(reductions.may_hide, range(len(sought.effects))))
    may_change = any(change is not None for change in search.split.changes)
    return reductions_of(search.readings, search.split, base, sought) if may_hide and may_change else None


def judged(nominal: Nominal, records: Sequence[Record], holdouts: Sequence[Record] = ()) -> Verdict:
    """Return the verdict alone, by the probability models of the package: nothing drawn, proposed or described.

    See `diagnose` for parameters and errors.
    """
    with _diagnosing(nominal.axis):
        found = _searched(_on_paper(nominal, records, holdouts))
        return verdict(found.findings, probability_models.models())


def calibrated_on(
    nominal: Nominal, records: Sequence[Record], progress: Callable[[str], None] | None = None
) -> tuple[Nominal, Baseline]:
    """Return the model with its nominal parameters calibrated on records, and what it leaves of them.

    What is left to doubt is what changes on one machine: see `fdbench.diagnosis.settings.BaselineSettings`.
    """
    # What is late every day is in what the baseline leaves; once known, no later force could be found.
    doubt = dataclasses.replace(nominal.uncertainty, loop_lag=0.0, encoder_delay=0.0)
    in_time = dataclasses.replace(nominal, uncertainty=doubt)

    def beside(known: Sequence[Effect]) -> Aligned:
        return aligned(in_time.knowing(known), records, ()).whole()

    ready = beside(nominal.drive.effects)
    _say(progress, "calibrating on the baseline")
    found = that_sticks(Calibrated.of(ready), beside)
    model, readings, runs = found.hypothesis, found.refinement.readings, found.ready.split.runs
    residuals = [
        {name: measured - readings.alone(place, model)[name] for name, measured in run.channels.items()}
        for place, run in enumerate(runs)
    ]
    # Another day changes no screw, whatever the model had on paper.
    of_a_day = dataclasses.asdict(BASELINE)
    offset_N = of_a_day.pop("force_offset") * ready.nominal.force_offset_N
    fixed = dict.fromkeys(("known_phase", "bristle_form", "stiffness", "damping", "loop_lag", "encoder_delay"), 0.0)
    doubt = Uncertainty(**of_a_day | fixed, force_offset_N=offset_N)
    known = dataclasses.replace(as_nominal(model), uncertainty=doubt)
    said = [text for text in found.ready.assumptions if text not in ready.assumptions]
    return known, Baseline(runs=runs, residuals=residuals, artefacts=found.ready.artefacts, said=said)


def write_experiment(found: Diagnosis, path: str | Path) -> Diagnosis:
    """Write the motion that a diagnosis proposes, as CSV or Parquet, and return the diagnosis with the file named.

    Where nothing is proposed, nothing is written and the diagnosis is returned as it is.

    Raises
    ------
    RecordError
        If the file cannot be written.
    """
    experiment = found.answer.next_experiment
    if found.forecast is None or experiment is None:
        return found
    motion = found.forecast.trajectory.record()
    (motion if found.answer.axis == LINEAR else record_of_rotary(motion)).save(path)
    named = dataclasses.replace(experiment, trajectory=str(path), file=str(path))
    return dataclasses.replace(found, answer=dataclasses.replace(found.answer, next_experiment=named))
