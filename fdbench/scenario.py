"""Scenarios: what a machine is nominally, what it really is, how it is moved, measured and scored.

One strict TOML file for each versioned id; see the ``scenarios`` folder.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from fdbench.catalogue import scenario_folder, scenario_ids
from fdbench.draw import Draw, check_draws, drawn, moved
from fdbench.effects import Effect
from fdbench.errors import MissingData, SimulationDiverged, SpecError, UnknownName, did_you_mean
from fdbench.estimator import Context
from fdbench.files import LONGEST_NAME, PLAIN_NAME
from fdbench.motions import Motion
from fdbench.plants import LinearModel, Plant
from fdbench.reading import measured_file, read_mapped
from fdbench.record import FloatArray, Record
from fdbench.regression import Regression
from fdbench.simulate.start import Start
from fdbench.simulate.system import Noise, Setup, System, Timing
from fdbench.specification import check_bounds, load_toml, positive, read
from fdbench.version import __version__

TRACKS = ("parameters", "disturbance", "output")
SUITES = ("quick", "full")


@dataclass(frozen=True, kw_only=True)
class Reality:
    """What the machine really is: effects that the nominal model does not know, and noises."""

    effects: tuple[Effect, ...] = ()
    noise: Noise = field(default_factory=Noise)


@dataclass(frozen=True, kw_only=True)
class Measured:
    """A measured record in place of a simulation.

    Parameters
    ----------
    file : str
        Path within the folder of measured data.
    obtain : str
        Where a user gets the file.
    columns : mapping
        How the file's columns become columns of a record; see `fdbench.record.read_mapped`.
    reference_parameters : mapping of str to float
        Published values, which stand in for the truth.
    """

    file: str
    obtain: str
    columns: Mapping[str, Any]
    reference_parameters: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Estimation:
    """What is to be estimated and what is known for it.

    Parameters
    ----------
    model : str
        Linear model of the plant.
    tracks : tuple of str
        Which leaderboards the scenario counts for: parameters, disturbance, output.
    disturbance_period_s : float, optional
        Period of spindle or shaker.
    disturbance_pitch_m : float, optional
        Pitch of the magnets, where the disturbance repeats with the position.
    window_s : pair of float, optional
        Part of the record in which disturbance errors are scored.
    hyperparameters : mapping
        Constructor arguments by estimator name, where a source publishes them.
    """

    model: str
    tracks: tuple[str, ...]
    disturbance_period_s: float | None = positive(default=None)
    disturbance_pitch_m: float | None = positive(default=None)
    window_s: tuple[float, float] | None = None
    hyperparameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_bounds(self)
        for track in self.tracks:
            if track not in TRACKS:
                raise SpecError(f"tracks: unknown track '{track}'.{did_you_mean(track, TRACKS)}")
        if self.window_s is not None and not 0.0 <= self.window_s[0] < self.window_s[1]:
            raise SpecError(f"window_s: {list(self.window_s)} is no part of a record; allowed: 0 <= start < stop.")


@dataclass(frozen=True, kw_only=True)
class Validation:
    """A motion that estimators predict unseen, by a free run, or one simulated with what they found; one of the three.

    Parameters
    ----------
    motion : Motion, optional
        Of the same machine, simulated without process forces and noise.
    start_s : float, optional
        Of a measured record: what comes from here on is withheld.
    open_loop : bool
        Of a measured feed drive: nothing is withheld; its position is simulated from its force alone, with the
        parameters that were found (`open_loop_position_error`).
    """

    motion: Motion | None = None
    start_s: float | None = positive(default=None)
    open_loop: bool = False

    def __post_init__(self) -> None:
        check_bounds(self)

    def check(self, is_measured: bool) -> None:
        """Raise a SpecError unless it says one thing, of those that a simulated or a measured scenario may say."""
        given = {name for name in ("motion", "start_s", "open_loop") if getattr(self, name) not in (None, False)}
        kind, allowed = ("measured", {"start_s", "open_loop"}) if is_measured else ("simulated", {"motion"})
        if len(given) != 1 or not given <= allowed:
            found = f"found {' and '.join(sorted(given))}" if given else "found none"
            raise SpecError(f"validation: a {kind} scenario has {' or '.join(sorted(allowed))}, {found}.")


@dataclass(frozen=True, kw_only=True)
class Environment:
    """Gymnasium side: what an action of 1 means, and which error the reward squares.

    Parameters
    ----------
    action_scale : float
        Deviation from the command at action 1, in the unit of the controller's command.
    reward : str
        Column whose difference to its reference column is squared, such as ``velocity_m_per_s``; for a plant with
        several axes ``position_m`` stands for ``x_position_m`` and ``y_position_m``, and the squares are added.
    """

    action_scale: float = positive()
    reward: str


@dataclass(frozen=True, kw_only=True)
class Truth:
    """What only the simulation knows.

    Attributes
    ----------
    parameters : mapping of str to float
        Parameters of the scenario's model, discrete or physical.
    disturbance_N : (n_samples,) array or None
        Mean process force against motion over each sampling time.
    response : (n_rows,) array or None
        What the model's target is in the validation motion.
    """

    parameters: Mapping[str, float]
    disturbance_N: FloatArray | None
    response: FloatArray | None = None

    def output(self, regression: Regression) -> FloatArray | None:
        r"""Return what the truth predicts of a regression's target, :math:`Z \beta + g d`, (n_rows,).

        g is the disturbance gain. Without a known disturbance d is left out; without every parameter of the regression
        nothing is predicted. What remains of the target is noise and what no linear model holds.
        """
        if any(name not in self.parameters for name in regression.names):
            return None
        predicted = regression.regressors @ np.array([self.parameters[name] for name in regression.names])
        if self.disturbance_N is not None:
            predicted = predicted + regression.disturbance_gain * self.disturbance_N[regression.rows]
        return np.asarray(predicted, dtype=np.float64)


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """One versioned benchmark case; the fields are the tables of its TOML file.

    A file may take over another one, ``extends = "ShakerConstant-v0"``, and say only what differs; lists are replaced
    whole. With ``draw`` every seed is another machine; without it the machine is the nominal one, as in a published
    trial.
    """

    title: str
    source: str
    suites: tuple[str, ...]
    plant: Plant
    estimation: Estimation
    timing: Timing | None = None
    motion: Motion | None = None
    start: Start = field(default_factory=Start)
    reality: Reality = field(default_factory=Reality)
    environment: Environment | None = None
    measured: Measured | None = None
    validation: Validation | None = None
    draw: tuple[Draw, ...] = ()
    id: str = field(default="", init=False)
    digest: str = field(default="", init=False)

    def __post_init__(self) -> None:
        if self.estimation.model not in self.plant.models():
            raise SpecError(
                f"estimation.model: the plant offers no model '{self.estimation.model}'."
                f"{did_you_mean(self.estimation.model, self.plant.models())}"
            )
        for suite in self.suites:
            if suite not in SUITES:
                raise SpecError(f"suites: unknown suite '{suite}'.{did_you_mean(suite, SUITES)}")
        if self.measured is not None and self.draw:
            raise SpecError("draw: a measured machine is not drawn; leave this table out.")
        if self.validation is not None:
            self.validation.check(self.measured is not None)
            if self.validation.open_loop and self.estimation.model != "inverse_dynamics":
                raise SpecError(f"validation.open_loop: needs the model inverse_dynamics, not {self.estimation.model}.")
        if self.measured is None and (self.timing is None or self.motion is None):
            raise SpecError("timing: missing table; a scenario has [timing] and [motion], or [measured].")
        if self.start != Start():
            self._check_start()

    def _check_start(self) -> None:
        limits = self.plant.table_limits
        if self.measured is not None or limits is None or self.motion is None or self.timing is None:
            what = "a measured machine" if self.measured is not None else f"a {self.plant.name}"
            raise SpecError(
                f"start: {what} begins where it does; only simulated feed drives and servo stages have one."
            )
        self.start.check(_reference(self.motion, self.timing), *limits)

    @property
    def content_digest(self) -> str:
        """Digest with that of the measured file, where there is one on this machine; else the digest."""
        if self.measured is None:
            return self.digest
        try:
            data = measured_file(self.measured.file, self.measured.obtain).read_bytes()
        except MissingData:
            return self.digest
        return hashlib.sha256(self.digest.encode() + hashlib.sha256(data).digest()).hexdigest()

    @property
    def linear_model(self) -> LinearModel:
        """The plant's linear model that is to be identified."""
        return self.plant.linear_model(self.estimation.model)

    def context(self) -> Context:
        """Return what an estimator may know."""
        period = self.timing.sampling_time_s if self.timing else self.record().sampling_time_s
        return Context(
            sampling_time_s=period,
            plant=self.plant,
            model=self.estimation.model,
            disturbance_period_s=self.estimation.disturbance_period_s,
            disturbance_pitch_m=self.estimation.disturbance_pitch_m,
            covariance=self._covariance,
        )

    @cached_property
    def _covariance(self) -> FloatArray | None:
        """How far the model's parameters may be from the nominal ones: to first order, each draw moved both ways.

        None where the machine is not drawn, or where what is drawn moves no parameter of the model.
        """
        own = [draw for draw in self.draw if any(path.startswith("plant.") for path in draw.values)]
        if not own or self.timing is None:
            return None
        model, period_s = self.estimation.model, self.timing.sampling_time_s

        def parameters(draw: Draw, deviations: float) -> FloatArray:
            plant = moved(self, draw, deviations).plant
            return np.array(list(plant.linear_model(model).nominal_parameters(period_s).values()))

        changes = np.array([0.5 * (parameters(draw, 1.0) - parameters(draw, -1.0)) for draw in own])
        return np.asarray(changes.T @ changes) if changes.any() else None

    def drawn(self, seed: int) -> "Scenario":
        """Return the scenario with the machine of a seed, nominally and in reality; itself where nothing is drawn."""
        if not self.draw:
            return self
        return _named(replace(drawn(self, self.draw, seed), draw=()), self.id, self.digest)

    @cached_property
    def setup(self) -> Setup:
        """How the plant is moved, disturbed and measured."""
        if self.timing is None or self.motion is None:
            raise SpecError(f"{self.id}: a measured scenario cannot be simulated; it has no [timing] and [motion].")
        return Setup(
            timing=self.timing,
            motion=self.motion,
            noise=self.reality.noise,
            unmodelled=self.reality.effects,
            start=self.start,
        )

    def system(self, n_lanes: int = 1) -> System:
        """Return instances of the machine as it really is."""
        return self.plant.system(self.setup, n_lanes)

    def record(self, seed: int = 0) -> Record:
        """Return what a logger on the machine would write, and nothing else."""
        return self.observe(seed)[0]

    def observe(self, seed: int = 0) -> tuple[Record, Truth]:
        """Return a record and the truth behind it.

        Raises
        ------
        SimulationDiverged
            If the axis leaves its travel or its velocity limit.
        MissingData
            If the scenario is measured and its file is not on this machine.
        """
        if self.measured is not None:
            record, withheld = self._measurement()
            response = None if withheld is None else self.linear_model.regression(withheld).target
            parameters = dict(self.measured.reference_parameters)
            return record, Truth(parameters=parameters, disturbance_N=None, response=response)
        machine = self.drawn(seed)
        record, truth = simulate(machine, seed)
        return record, replace(truth, response=machine.response(seed))

    def _measurement(self) -> tuple[Record, Record | None]:
        """Return the measured record that is handed out, and the part that is withheld."""
        if self.measured is None:
            raise SpecError(f"{self.id}: nothing is measured.")
        path = measured_file(self.measured.file, self.measured.obtain)
        mapping = {"record": {"file": path.name}, "columns": self.measured.columns}
        record = read_mapped(mapping, path.parent, f"{self.id}: measured")
        end_s = float(record["time_s"][-1])
        _check_window(self.estimation, end_s, record.sampling_time_s, f"{self.id}: scenario")
        if self.validation is None or self.validation.start_s is None:
            return record, None
        first = int(np.searchsorted(record["time_s"], self.validation.start_s))
        return record.slice(0, first), record.slice(first, record.n_samples)

    def command(self) -> Record | None:
        """Return what is known beforehand of the validation motion: its commands, on the clock of the record."""
        if self.validation is None:
            return None
        if self.timing is None:
            withheld = self._measurement()[1]
            if withheld is None:
                return None
            known = {name: withheld[name] for name in withheld.columns if "reference_" in name}
            return Record({"time_s": withheld["time_s"], **known}, {}, f"{self.id}: validation")
        system = self._validating.system()
        time_s = np.arange(system.n_samples, dtype=np.float64) * self.timing.sampling_time_s
        return Record({"time_s": time_s, **system.commanded}, {}, f"{self.id}: validation")

    def response(self, seed: int) -> FloatArray | None:
        """Return the model's target in the validation motion, (n_rows,), or None without one."""
        if self.validation is None or self.validation.motion is None:
            return None
        record, _ = simulate(self._validating, seed)
        return self.linear_model.regression(record).target

    @property
    def _validating(self) -> "Scenario":
        """The machine in its validation motion, undisturbed and read without noise."""
        if self.validation is None or self.validation.motion is None:
            raise SpecError(f"{self.id}: it has no [validation.motion].")
        effects = tuple(effect for effect in self.reality.effects if not (effect.disturbance or effect.random))
        motion, reality = self.validation.motion, Reality(effects=effects)
        other = replace(self, motion=motion, start=Start(), reality=reality, validation=None)
        return _named(other, self.id, self.digest)


@lru_cache(maxsize=64)
def _reference(motion: Motion, timing: Timing) -> FloatArray:
    return motion.reference(timing.sampling_time_s, timing.n_samples)


def _check_window(estimation: Estimation, end_s: float, sampling_time_s: float, where: str) -> None:
    if estimation.window_s is None:
        return
    first_s, last_s = estimation.window_s
    if last_s > end_s or last_s - first_s < sampling_time_s:
        raise SpecError(
            f"{where}.estimation.window_s: {[first_s, last_s]} is no part of a record of {end_s:g} s in samples of "
            f"{sampling_time_s:g} s."
        )


def simulate(scenario: Scenario, seed: int) -> tuple[Record, Truth]:
    """Run one episode of the scenario's own command."""
    system = scenario.system()
    system.start([seed])
    rows = system.advance(system.n_samples)[:, :, 0]
    if bool(system.diverged[0]) or not np.isfinite(rows).all():
        raise SimulationDiverged(f"{scenario.id}, seed {seed}: the axis left its travel or velocity limit.")
    period = scenario.setup.timing.sampling_time_s
    time_s = np.arange(system.n_samples, dtype=np.float64) * period
    columns: dict[str, FloatArray] = {"time_s": time_s, **system.commanded}
    columns |= {name: rows[:, index] for index, name in enumerate(system.columns)}
    withheld = {name: rows[:, len(system.columns) + index] for index, name in enumerate(system.truth_columns)}
    if "held_sample" in withheld and withheld["held_sample"].any():
        columns["held_sample"] = withheld["held_sample"]
    provenance = {"scenario": scenario.id, "digest": scenario.digest, "seed": seed, "version": __version__}
    record = Record(columns, provenance, f"{scenario.id} seed {seed}")
    parameters = scenario.linear_model.nominal_parameters(period)
    return record, Truth(parameters=parameters, disturbance_N=withheld.get("disturbance_N"))


def load_scenario(name_or_path: str | Path) -> Scenario:
    """Return a scenario by id (``ShakerConstant-v0``, with or without ``fdbench/``) or by the path of a TOML file.

    Raises
    ------
    UnknownName
        If there is no such id; the message gives the nearest one.
    SpecError
        If the file breaks the schema.
    """
    name = str(name_or_path)
    if name.endswith(".toml"):
        return _load(Path(name))
    identifier = name.removeprefix("fdbench/")
    path = scenario_folder() / f"{identifier}.toml"
    if not path.is_file():
        raise UnknownName(f"unknown scenario '{name}'.{did_you_mean(identifier, scenario_ids())}")
    return _load_packaged(path)


def _load(path: Path) -> Scenario:
    if not PLAIN_NAME.fullmatch(path.stem):
        raise SpecError(
            f"{path.name}: the name of the file, without .toml, is the id of the scenario; allowed: up to "
            f"{LONGEST_NAME} letters, digits, blanks, _, - and ., the first of them a letter, a digit or _."
        )
    table, parts = extended(path)
    scenario = read(Scenario, table, f"{path.name}: scenario")
    digest = hashlib.sha256(parts[0] if len(parts) == 1 else b"".join(hashlib.sha256(part).digest() for part in parts))
    _named(scenario, path.stem, digest.hexdigest())
    if scenario.timing is not None:
        timing = scenario.timing
        _check_window(scenario.estimation, timing.duration_s, timing.sampling_time_s, f"{path.name}: scenario")
    try:
        check_draws(scenario, scenario.draw)
    except SpecError as error:
        raise SpecError(f"{path.name}: {error}") from error
    return scenario


def extended(path: Path, below: tuple[str, ...] = ()) -> tuple[dict[str, Any], list[bytes]]:
    """Return the tables of a file over those of the one that it extends, and the content of both.

    Raises
    ------
    SpecError
        If a file cannot be read, or it extends itself or what is not there.
    """
    table = load_toml(path)
    content = path.read_bytes()
    if "extends" not in table:
        return table, [content]
    base = table.pop("extends")
    allowed = [file.stem for file in path.parent.glob("*.toml")] + scenario_ids()
    if not isinstance(base, str) or base in below or base == path.stem or base not in allowed:
        raise SpecError(
            f"{path.name}: extends: the id of another scenario, beside this file or of fdbench, is expected, found "
            f"{base!r}.{did_you_mean(str(base), allowed)}"
        )
    beside = path.parent / f"{base}.toml"
    file = beside if beside.is_file() else scenario_folder() / f"{base}.toml"
    lower, parts = extended(file, (*below, path.stem))
    return _over(lower, table), [content, *parts]


def _over(lower: Mapping[str, Any], upper: Mapping[str, Any]) -> dict[str, Any]:
    """Return one table over another; tables within are merged, all else is replaced."""
    merged = dict(lower)
    for key, value in upper.items():
        below = merged.get(key)
        if isinstance(below, Mapping) and isinstance(value, Mapping):
            # A table of another kind has other keys: it replaces the lower one whole.
            is_same = value.get("kind", below.get("kind")) == below.get("kind")
            merged[key] = _over(below, value) if is_same else value
        else:
            merged[key] = value
    return merged


def _named(scenario: Scenario, name: str, digest: str) -> Scenario:
    object.__setattr__(scenario, "id", name)
    object.__setattr__(scenario, "digest", digest)
    return scenario


@lru_cache(maxsize=256)
def _load_packaged(path: Path) -> Scenario:
    return _load(path)
