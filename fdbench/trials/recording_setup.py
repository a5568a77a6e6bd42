"""A machine and what is recorded on it: virtual machines move as it did, and are logged with its noise."""

import dataclasses
import hashlib
import inspect
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from fdbench.diagnosis.diagnose import judged
from fdbench.diagnosis.evidence.prepare import Aligned, aligned
from fdbench.diagnosis.evidence.run_to_run import Repeatability
from fdbench.diagnosis.model.commands import at_each_loop
from fdbench.diagnosis.model.hypothesis import Hypothesis, start
from fdbench.diagnosis.model.known_effects import silent
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.model.rotary_axis import record_of_rotary
from fdbench.diagnosis.records.runs import COMMAND, DEFLECTION, SIDES, RecordedRun, same_force
from fdbench.diagnosis.repaired import table_of, toml_lines
from fdbench.diagnosis.settings import JUDGE
from fdbench.errors import SpecError
from fdbench.record import FloatArray, Record
from fdbench.rotary import LINEAR
from fdbench.trials import seal
from fdbench.trials.virtual_machine import Visibility
from fdbench.virtual_axes import cases as tiers
from fdbench.virtual_axes.library_axis import USUAL, LibraryAxis, Noises, rubbing

STEPS = 4  # of a floor in a factor of two: records of one machine share what was learned
NAMES = [field.name for field in dataclasses.fields(Noises)]  # the last one is friction
SILENT = Noises(**dict.fromkeys(NAMES, 0.0))
ROUNDS = 2
LEAST = 1e-3  # smallest mean square of a part of a floor
EVEN = 0.1  # weight of keeping to equal parts where the floors do not tell noises apart
UNHEARD = 1e-6  # of the loudest noise, below which another one is not in the floors
OFF = 2.0  # factor by which the floor of a channel may be missed
RUBBING = tiers.FRICTION_CHANGE[1]
RUN_UP_S = 1.0


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
        """Return the mean squares of noise within a run and of changes from run to run, (2, n_channels).

        Changes that are only assumed, as nothing was repeated, are none.
        """
        noise = Repeatability(ready.readings.replay, start(ready.nominal), ready.runs).noise_models.values()
        within = np.array([floor.rms**2 for floor in noise])
        between = np.array([floor.total**2 - floor.rms**2 if floor.measured else 0.0 for floor in noise])
        return np.stack((within, between))

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all that the cases depend on: code, effects, model, motions, columns and noise."""
        kinds = [inspect.getsource(kind.declared) for kind in self.ready.nominal.library]
        model = toml_lines(table_of(self.nominal, Nominal))
        every = [run.whole.held for run in self.ready.runs]
        held = [own.tobytes() if self.holds and own is not None else b"" for own in every]
        moved = [self.command(run).tobytes() for run in self.ready.runs]
        motions = [hashlib.sha256(part).hexdigest() for part in (*moved, *held)]
        recorded = [
            self.names,
            self.ready.n_fitted,
            self.ready.runs[0].period_s,
            self.noise_models,
            self.parts.tolist(),
        ]
        content = [seal.code_digest(), kinds, list(model), motions, recorded]
        return hashlib.sha256(seal.canonical(content)).hexdigest()

    @property
    def loops(self) -> int:
        """Cycles of the controller in a sampling time."""
        return self.ready.nominal.simulation.cycles

    @property
    def holds(self) -> bool:
        """Whether the logger held samples."""
        return any(artefact.interpolated for artefact in self.ready.artefacts)

    @staticmethod
    def command(run: RecordedRun) -> FloatArray:
        """Return the command (n, 3) of a run; where it was followed, the motion that was measured."""
        whole = run.whole
        return whole.reference if whole.motion is None else np.column_stack((whole.motion[0], whole.reference[:, 1:]))

    @staticmethod
    def with_run_up(run: RecordedRun) -> FloatArray:
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

    def moving_as(self, run: RecordedRun) -> RecordedRun:
        """Return the run whose motion is that of a virtual run, too.

        Under the same force an axis in open loop moves apart, but a virtual machine is moved: its repeats move alike.
        """
        return next(other for other in self.ready.runs if other is run or same_force(other, run))

    @cached_property
    def visibility(self) -> Visibility:
        """How far effects show in the motions."""
        return Visibility(ready=self.ready)

    def axis(self, machine: Hypothesis, noises: Noises) -> LibraryAxis:
        """Return a machine that records can be made of."""
        variant, nominal = machine.variant, self.ready.nominal
        reach_m = max(float(np.abs(self.with_run_up(run)[:, 0]).max()) for run in self.ready.runs)
        # The zero of a record may lie anywhere, and what was recorded is within the limits.
        drive = dataclasses.replace(
            variant.plant,
            travel_m=nominal.drive.travel_m + reach_m,
            velocity_limit_m_per_s=2.0 * nominal.drive.velocity_limit_m_per_s,
        )
        own = {effect.declared: effect for effect in variant.extra}
        return LibraryAxis(
            drive=drive,
            unmodelled=tuple(own.get(kind.declared, silent(kind)) for kind in self.visibility.kinds),
            period_s=self.ready.runs[0].period_s / self.loops,
            noises=noises,
            substeps=-(-nominal.simulation.substeps // self.loops),
        )

    def recorded(self, axis: LibraryAxis, rng: np.random.Generator) -> tuple[list[Record], list[Record]]:
        """Return what the logger writes of every motion: to fit, and to judge on."""
        found: list[Record] = []
        for own in self.ready.runs:
            run = self.moving_as(own).whole
            command = self.command(run)
            made = axis.readings(at_each_loop(self.with_run_up(run), run.period_s, self.loops), rng)
            readings = {name: values[:: self.loops][-run.n_samples :] for name, values in made.items()}
            columns = {name: readings.get(name, readings["position_m"]) for name in (*self.names, "motor_force_N")}
            if self.holds and run.held is not None:
                last = np.maximum.accumulate(np.where(run.held, 0, np.arange(run.n_samples)))
                columns = {name: values[last] for name, values in columns.items()}
            if run.motion is None:
                rates = ("reference_velocity_m_per_s", "reference_acceleration_m_per_s2")
                columns |= {name: command[:, place] for place, name in enumerate((COMMAND, *rates))}
            columns["time_s"] = np.arange(run.n_samples, dtype=np.float64) * run.period_s
            record = Record(columns, source=own.name)
            found.append(record if self.nominal.axis == LINEAR else record_of_rotary(record))
        return found[: self.ready.n_fitted], found[self.ready.n_fitted :]

    def case(self, noises: Noises, rng: np.random.Generator) -> dict[str, Any]:
        """Draw, record and diagnose one case, and return the features of each claim, the truth and what is named."""
        causes = self.visibility.draw(rng)
        records, holdouts = self.recorded(self.axis(causes.machine, noises), rng)
        unlisted = self.nominal.with_equivalents(causes.taken_out)
        nominal = dataclasses.replace(self.nominal, exclude=(*self.nominal.exclude, *unlisted))
        verdict = judged(nominal, records, holdouts)
        truth: dict[str, list[dict[str, Any]]] = {"listed": [], "unlisted": []}
        for name, effect in causes.injected.items():
            item = {"name": name, "parameters": vars(effect), "mean_square": causes.mean_squares[name]}
            truth["unlisted" if name in causes.taken_out else "listed"].append(item)
        named = [
            [cause.effect, *cause.indistinguishable_from] for cause in verdict.causes if cause.probability > JUDGE.named
        ]
        return {"features": verdict.features, "truth": truth, "named": named}

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
            # A sensor that is not recorded and closes no loop has no noise to speak of.
            size = np.linalg.norm(squares, axis=0)
            size = np.where(size > UNHEARD * size.max(), size, math.inf)
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
        axis = self.axis(self.visibility.given, noises)
        made = aligned(self.nominal, *self.recorded(axis, seal.generator(self.digest, "noise")), logged=False)
        return np.asarray(self.squares(made) / np.array(list(self.noise_models.values())) ** 2)

    def _made_by_friction(self) -> FloatArray:
        """Return the mean squares of what runs differ by where friction differs by 5 %, (2, n_channels), like `parts`.

        A floor that was not measured from repeats knows nothing of it.
        """
        if not any(floor.measured for floor in self.ready.split.noise_models.values()):
            return np.zeros_like(self.parts)
        axis = self.axis(self.visibility.given, SILENT)
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
