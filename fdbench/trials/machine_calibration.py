"""Machine-specific calibration: probability models learned on simulated cases of one machine.

The cases have the motions, columns and noise of its records. The models that the package is shipped with are the prior
mean, from which the machine's own cases move them.
"""

import dataclasses
import hashlib
import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from fdbench.diagnosis.diagnose import diagnose
from fdbench.diagnosis.evidence.prepare import Aligned, aligned
from fdbench.diagnosis.evidence.run_to_run import Repeatability
from fdbench.diagnosis.judge import probability_models as confidence
from fdbench.diagnosis.judge.probability_models import ProbabilityModels
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.model.rotary_axis import record_of_rotary
from fdbench.diagnosis.records.runs import COMMAND, DEFLECTION, SIDES, Run, merged
from fdbench.diagnosis.repaired import table_of, toml_lines
from fdbench.documents import LARGEST_JSON, json_value, read_file
from fdbench.errors import FdbenchError, SpecError
from fdbench.record import FloatArray, Record
from fdbench.rotary import LINEAR
from fdbench.simulate.compose import cache_folder
from fdbench.trials import seal
from fdbench.trials.forms import check_learned
from fdbench.trials.learn import Claim, claims, fitted
from fdbench.trials.make import MOST_ATTEMPTS
from fdbench.virtual_axes import cases as tiers
from fdbench.virtual_axes.bench import ERRORS
from fdbench.virtual_axes.library_axis import USUAL, LibraryAxis, LibraryBench, Noises, rubbing

STEPS = 4  # of a floor in a factor of two: records of one machine share what was learned
NAMES = [field.name for field in dataclasses.fields(Noises)]  # the last one is friction
SILENT = Noises(**dict.fromkeys(NAMES, 0.0))
ROUNDS = 2
LEAST = 1e-3  # smallest mean square of a part of a floor
EVEN = 0.1  # weight of keeping to equal parts where the floors do not tell noises apart
OFF = 2.0  # factor by which the floor of a channel may be missed
MOVED = ("effect", "suspect", "value")
RUN_UP_S = 1.0
RUBBING = tiers.FRICTION_CHANGE[1]


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordingSetup:
    """One nominal machine, and what is recorded on it.

    Attributes
    ----------
    nominal : Nominal
        As the user gave it.
    ready : Aligned
        The user's records.
    names : tuple of str
        Columns of positions, on the arc of an axis that turns.
    """

    nominal: Nominal
    ready: Aligned
    names: tuple[str, ...]

    @cached_property
    def noise_models(self) -> Mapping[str, float]:
        """What repeats were measured to differ by, in steps."""
        measured = self.ready.split.noise_models.items()
        return {name: 2.0 ** (round(STEPS * math.log2(floor.total)) / STEPS) for name, floor in measured}

    @cached_property
    def parts(self) -> FloatArray:
        """Mean squares within a run and from run to run, (2, n_channels), in units of what repeats differ by."""
        measured = np.maximum(self.squares(self.ready) / np.array(list(self.noise_models.values())) ** 2, LEAST)
        return np.asarray(4.0 ** (np.round(0.5 * STEPS * np.log2(measured)) / STEPS))

    def squares(self, ready: Aligned) -> FloatArray:
        """Return the mean squares of noise within a run and of changes from run to run, (2, n_channels)."""
        noise = Repeatability(ready.readings.replay, start(ready.nominal), ready.runs).noise_models.values()
        within = np.array([floor.rms**2 for floor in noise])
        return np.stack((within, np.array([floor.total**2 for floor in noise]) - within))

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all that the cases depend on: code, effects, model, motions, columns and noise."""
        kinds = [inspect.getsource(kind.declared) for kind in self.ready.nominal.library]
        model = toml_lines(table_of(self.nominal, Nominal))
        held = [run.held.tobytes() if self.holds and run.held is not None else b"" for run in self.ready.runs]
        moved = [self.command(run).tobytes() for run in self.ready.runs]
        motions = [hashlib.sha256(part).hexdigest() for part in (*moved, *held)]
        recorded = [self.names, self.ready.n_fitted, self.ready.runs[0].period_s, self.noise_models, self.parts.tolist()]
        content = [seal.code_digest(), kinds, list(model), motions, recorded]
        return hashlib.sha256(seal.canonical(content)).hexdigest()

    @property
    def holds(self) -> bool:
        """Whether the logger held samples."""
        return any(artefact.interpolated for artefact in self.ready.artefacts)

    @staticmethod
    def command(run: Run) -> FloatArray:
        """Return the command (n, 3) of a run; where it was followed, the motion that was measured."""
        return run.reference if run.motion is None else np.column_stack((run.motion[0], run.reference[:, 1:]))

    @staticmethod
    def with_run_up(run: Run) -> FloatArray:
        """Return the command of a run after a run-up, at whose end the axis moves as it did where the record begins.

        Before a command that repeats itself is the end of a lap; else the speed rises from rest.
        """
        command = RecordingSetup.command(run)
        n = round(RUN_UP_S / run.period_s)
        if run.lap is not None:
            before = command[max(run.lap - n, 0) : run.lap].copy()
            before[:, 0] += command[0, 0] - command[run.lap, 0]
            return np.concatenate((before, command))
        share, speed = np.arange(n) / n, command[0, 1]
        velocity = speed * share**2 * (3.0 - 2.0 * share)
        way = speed * RUN_UP_S * (share**3 - 0.5 * share**4 - 0.5)
        acceleration = speed / RUN_UP_S * 6.0 * share * (1.0 - share)
        return np.concatenate((np.column_stack((command[0, 0] + way, velocity, acceleration)), command))

    def bench(self, errors: Mapping[str, float], noises: Noises) -> LibraryBench:
        """Return the machine."""
        nominal, period_s = self.ready.nominal, self.ready.runs[0].period_s
        reach_m = max(float(np.abs(self.with_run_up(run)[:, 0]).max()) for run in self.ready.runs)
        # The zero of a record may lie anywhere, and what was recorded is within the limits.
        drive = dataclasses.replace(
            nominal.drive,
            travel_m=nominal.drive.travel_m + reach_m,
            velocity_limit_m_per_s=2.0 * nominal.drive.velocity_limit_m_per_s,
        )
        nominal = dataclasses.replace(nominal, plant=drive)
        return LibraryBench(nominal, errors, period_s, noises, nominal.simulation.substeps)

    def recorded(self, axis: LibraryAxis, rng: np.random.Generator) -> tuple[list[Record], list[Record]]:
        """Return what the logger writes of every motion: to fit, and to judge on."""
        found: list[Record] = []
        for run in self.ready.runs:
            command = self.command(run)
            readings = {name: values[-run.n_samples :] for name, values in axis.readings(self.with_run_up(run), rng).items()}
            columns = {name: readings.get(name, readings["position_m"]) for name in (*self.names, "motor_force_N")}
            if self.holds and run.held is not None:
                last = np.maximum.accumulate(np.where(run.held, 0, np.arange(run.n_samples)))
                columns = {name: values[last] for name, values in columns.items()}
            if run.motion is None:
                rates = ("reference_velocity_m_per_s", "reference_acceleration_m_per_s2")
                columns |= {name: command[:, place] for place, name in enumerate((COMMAND, *rates))}
            columns["time_s"] = np.arange(run.n_samples, dtype=np.float64) * run.period_s
            record = Record(columns, source=run.name)
            found.append(record if self.nominal.axis == LINEAR else record_of_rotary(record))
        return found[: self.ready.n_fitted], found[self.ready.n_fitted :]

    def case(self, noises: Noises, rng: np.random.Generator) -> dict[str, Any]:
        """Draw, record and diagnose one case, and return the features of each claim beside the truth."""
        doubt = self.nominal.uncertainty
        deviations = {
            **dict.fromkeys(("motor_mass", "table_mass"), doubt.mass),
            **dict.fromkeys(("motor_viscous", "table_viscous"), doubt.viscous),
            **{"known": doubt.known_effects, "offset_N": self.ready.nominal.force_offset_N},
        }
        errors = {name: size * float(np.clip(rng.standard_normal(), -2.0, 2.0)) for name, size in deviations.items()}
        bench = self.bench(errors, noises)
        names = bench.names(listed=True)
        other = SIDES[not self.ready.nominal.drive.controller.uses_table]
        sides = ("position_m", other) if DEFLECTION in self.noise_models else ("position_m",)
        motions = [self.command(run) for run in merged(self.ready.runs[: self.ready.n_fitted])]
        injected, sizes = tiers.inject(bench, tiers.how_many(tiers.Tier.L, rng), names, motions, sides, rng)
        excluded = tiers.taken_out(bench, injected, rng)
        records, holdouts = self.recorded(bench.axis(injected), rng)
        unlisted = self.nominal.with_equivalents(excluded)
        nominal = dataclasses.replace(self.nominal, exclude=(*self.nominal.exclude, *unlisted))
        truth = tiers.described(injected, sizes, [name for name in names if name not in excluded])
        return {"features": diagnose(nominal, records, holdouts).features, "truth": truth}

    def noises(self) -> Noises:
        """Return the noises that give the nominal machine the measured noise floors, within a run and from run to run.

        The mean squares of the floors that each of them makes by itself add up (least squares, nonnegative).
        """
        from scipy.optimize import nnls

        found = USUAL
        for _ in range(ROUNDS):
            own = {name: dataclasses.replace(SILENT, **{name: getattr(found, name)}) for name in NAMES}
            made = [self._made_by(own[name]).ravel() for name in NAMES[:-1]]
            squares = np.column_stack([*made, self._made_by_friction().ravel()])
            size = np.maximum(np.linalg.norm(squares, axis=0), 1e-30)
            system = np.vstack((squares / size, EVEN * np.eye(len(NAMES))))
            parts, _ = nnls(system, np.r_[self.parts.ravel(), np.zeros(len(NAMES))])
            scale = np.sqrt(parts / size).tolist()
            before = dataclasses.replace(found, friction_change=RUBBING)
            found = Noises(**{name: getattr(before, name) * by for name, by in zip(NAMES, scale, strict=True)})
        together = np.sqrt(self._made_by(found).sum(axis=0)).tolist()
        for name, ratio in zip(self.noise_models, together, strict=True):
            if not 1.0 / OFF < ratio < OFF:
                raise SpecError(
                    f"--calibrate: no noise of sensors, process and friction gives the model the measured floor of "
                    f"{name}, {self.noise_models[name]:.3g}; the nearest gives {ratio * self.noise_models[name]:.3g}. "
                    "Check that repeats are of one command and one machine state, or diagnose without --calibrate."
                )
        return found

    def _made_by(self, noises: Noises) -> FloatArray:
        """Return the mean squares of the noise floors of a nominal machine, (2, n_channels), like `parts`."""
        axis = self.bench(dict.fromkeys(ERRORS, 0.0), noises).axis({})
        made = aligned(self.nominal, *self.recorded(axis, seal.generator(self.digest, "noise")), logged=False)
        return np.asarray(self.squares(made) / np.array(list(self.noise_models.values())) ** 2)

    def _made_by_friction(self) -> FloatArray:
        """Return the mean squares of what runs differ by where friction differs by 5 %, (2, n_channels), like `parts`.

        A floor that was not measured from repeats knows nothing of it.
        """
        if not any(floor.measured for floor in self.ready.split.noise_models.values()):
            return np.zeros_like(self.parts)
        axis = self.bench(dict.fromkeys(ERRORS, 0.0), SILENT).axis({})
        rubbed = dataclasses.replace(axis, drive=rubbing(axis.drive, 1.0 + RUBBING))
        moved: dict[str, list[FloatArray]] = {name: [] for name in self.noise_models}
        for run in self.ready.runs:
            one, two = (item.readings(self.command(run), None) for item in (axis, rubbed))
            change = {name: two[name] - one[name] for name in one}
            if DEFLECTION in moved:
                change[DEFLECTION] = change[SIDES[0]] - change[SIDES[1]]
            for name, parts in moved.items():
                parts.append(change[name])
        between = [float(np.mean(np.concatenate(moved[name]) ** 2)) / of**2 for name, of in self.noise_models.items()]
        return np.stack((np.zeros(len(between)), between))


def recording_setup(nominal: Nominal, records: Sequence[Record], holdouts: Sequence[Record]) -> RecordingSetup:
    """Return the machine and what is recorded on it.

    Raises
    ------
    RecordError
        If the records cannot be diagnosed.
    SpecError
        If the model cannot move as they show.
    """
    ready = aligned(nominal, records, holdouts)
    drive = ready.nominal.drive
    if drive.screw is None and DEFLECTION in ready.split.noise_models:
        raise SpecError(
            f"--calibrate: {records[0].source} has {' and '.join(SIDES)}, but the model has no [plant.screw] between "
            "them; add it, leave one column out, or diagnose without --calibrate."
        )
    on_the_arc = nominal.on_the_arc(records)[0]
    names = tuple(name for name in ("position_m", *SIDES) if name in on_the_arc)
    return RecordingSetup(nominal=nominal, ready=ready, names=names)


def calibrated_models(
    nominal: Nominal,
    records: Sequence[Record],
    holdouts: Sequence[Record],
    count: int,
    progress: Callable[[str], None] | None = None,
) -> ProbabilityModels:
    """Return probability models learned on simulated cases of the machine, with the motions and noise of its records.

    Cases are kept in the cache by the digest of all that they depend on; only those that it lacks are simulated.

    Parameters
    ----------
    nominal, records, holdouts
        As for `fdbench.diagnosis.diagnose.diagnose`.
    count : int
        Number of cases.
    progress : callable, optional

    Raises
    ------
    RecordError, SpecError
        If the records cannot be diagnosed or the model cannot be simulated like them.
    """
    setup = recording_setup(nominal, records, holdouts)
    kept = cache_folder() / f"calibration-{setup.digest}.json"
    cases: list[Any] = _kept_cases(kept) if kept.exists() else []
    noises = setup.noises() if len(cases) < count else USUAL
    while len(cases) < count:
        if progress is not None:
            progress(f"calibration: case {len(cases) + 1} of {count}")
        cases.append(_case(setup, noises, len(cases)))
        seal.write_json(kept, cases)
    found = [claim for case in cases[:count] for claim in claims(case["features"], case["truth"])]
    return adapted(
        found, confidence.models(), f"machine-specific calibration, {count} cases of this machine and its motions"
    )


def _kept_cases(path: Path) -> list[Any]:
    """Return the cases in a file of the cache."""
    where = f"{path}: not the cases of a calibration; remove it"
    try:
        cases: list[Any] = json_value(read_file(path, LARGEST_JSON))
    except (OSError, ValueError) as error:
        raise SpecError(f"{where}: {error}.") from error
    check_learned(cases, where)
    for kind in MOVED:
        names = {*getattr(confidence.models(), kind).features}
        if not all(names <= own.keys() for case in cases for own in case["features"][kind].values()):
            raise SpecError(f"{where}: other features of {kind} than those of this version.")
    return cases


def _case(setup: RecordingSetup, noises: Noises, number: int) -> dict[str, Any]:
    """Return a case; one that diverges, or whose records no one would diagnose, is drawn anew."""
    for attempt in range(MOST_ATTEMPTS):
        try:
            return setup.case(noises, seal.generator(setup.digest, f"case {number} attempt {attempt}"))
        except FdbenchError as error:
            message = str(error)
    raise SpecError(f"--calibrate: case {number + 1}: {MOST_ATTEMPTS} draws, none of them usable; the last: {message}")


def adapted(found: Sequence[Claim], prior: ProbabilityModels, source: str) -> ProbabilityModels:
    """Return probability models moved by claims of causes; a model without claims stays as it is.

    Those of an unknown cause and of no gap stay: moved, they were worse on fresh cases of a machine unlike tier L.
    """
    own = {kind: [claim for claim in found if claim.kind == kind] for kind in MOVED}
    moved: dict[str, Any] = {kind: fitted(some, getattr(prior, kind)) for kind, some in own.items() if some}
    return dataclasses.replace(prior, **moved, source=source)
