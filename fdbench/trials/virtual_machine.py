"""Virtual machines like a measured one: values within its uncertainty, traces of every effect, and up to three causes.

Values are drawn as every hypothesis may move them. Sizes of causes are drawn by what they change in the records: from
hardly visible to a few times the gap that the nominal model leaves of the measured ones.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fdbench.diagnosis.evidence.prepare import Aligned
from fdbench.diagnosis.model.hypothesis import Hypothesis, start
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.model.replay import Replay
from fdbench.effects import Effect
from fdbench.errors import SimulationDiverged
from fdbench.record import FloatArray
from fdbench.virtual_axes.bench import between
from fdbench.virtual_axes.cases import TAKEN_OUT, Tier, how_many
from fdbench.virtual_axes.library_axis import BACKGROUND, SIZES, TRACE, drawn_shape

LEAST, MOST = 3.0, 4.0  # mean square of a cause, in units of the noise, and of the measured gap
BEYOND = (2.5, 6.0)  # standard deviations of a nominal parameter that is a cause
MOST_DRAWS = 40
RESIZED = 4  # times, at most


@dataclass(frozen=True, kw_only=True, eq=False)
class Causes:
    """What is injected in one virtual machine.

    Attributes
    ----------
    machine : Hypothesis
        With drawn values, causes and traces of all other effects.
    injected : mapping of str to Effect
    mean_squares : mapping of str to float
        What each changes in the run where it shows most, in units of the noise of a sample.
    taken_out : tuple of str
        Those that the diagnosis is not told of.
    """

    machine: Hypothesis
    injected: Mapping[str, Effect]
    mean_squares: Mapping[str, float]
    taken_out: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Visibility:
    """How far effects show in the motions of records; what all cases of one machine share.

    Attributes
    ----------
    ready : Aligned
        The measured records.
    """

    ready: Aligned

    @cached_property
    def given(self) -> Hypothesis:
        """The nominal model."""
        return start(self.ready.nominal)

    @cached_property
    def kinds(self) -> list[type[Effect]]:
        """Effects that can be injected."""
        nominal = self.ready.nominal
        elastic = nominal.drive.screw is not None
        return [kind for kind in nominal.library if elastic or not kind.needs_screw]

    @cached_property
    def _replay(self) -> Replay:
        return self.ready.readings.coarsened(self.given, self.ready.split.noise_models).replay

    @cached_property
    def _nominal_changes(self) -> list[FloatArray]:
        """Orthonormal directions in which the nominal parameters move each run, (n_readings, n_parameters)."""
        return [np.linalg.qr(own.T)[0] for own in self._changes(self.given.moved_in_turn())]

    def _changes(self, hypotheses: Sequence[Hypothesis]) -> list[FloatArray]:
        """Return what hypotheses change in each run, in units of the noise, (n_hypotheses, n_readings)."""
        found = []
        noise = self.ready.split.noise_models
        for run in self.ready.split.runs:
            simulated = self._replay.simulate(run, [item.variant for item in (self.given, *hypotheses)])
            found.append(np.hstack([(own[1:] - own[0]) / noise[name].total for name, own in simulated.items()]))
        return found

    def mean_squares(self, hypotheses: Sequence[Hypothesis], *, beside_values: bool) -> FloatArray:
        """Return what hypotheses change in the run where that is most, mean square in units of the noise.

        Parameters
        ----------
        hypotheses : sequence of Hypothesis
        beside_values : bool
            Whether what nominal parameters could do as well does not count.

        Returns
        -------
        (n_hypotheses,) array
            Not a number where a simulation diverges.
        """
        sizes = []
        for place, own in enumerate(self._changes(hypotheses)):
            if beside_values:
                basis = self._nominal_changes[place]
                own = own - (own @ basis) @ basis.T
            sizes.append(np.mean(own**2, axis=1))
        return np.asarray(np.max(sizes, axis=0))

    @cached_property
    def gap(self) -> float:
        """Mean squared gap of the records to the nominal model in units of the noise, but for its values."""
        noise, sizes = self.ready.split.noise_models, []
        for place, run in enumerate(self.ready.split.runs):
            simulated = self._replay.alone(run, self.given.variant)
            left = np.concatenate([(run.channels[name] - own) / noise[name].total for name, own in simulated.items()])
            basis = self._nominal_changes[place]
            sizes.append(float(np.mean((left - basis @ (basis.T @ left)) ** 2)))
        return max(sizes)

    @cached_property
    def deviations(self) -> Mapping[str, float]:
        """Mean square of a standard deviation of the nominal parameters that an effect corrects, by its name."""
        items = nominal_parameters(self.ready.nominal)
        squares = self.mean_squares(self.given.moved_in_turn(), beside_values=False)
        found: dict[str, float] = {}
        for item, square in zip(items, squares.tolist(), strict=True):
            if not item.nuisance and (name := item.cause(self.ready.nominal)):
                found[name] = max(square, found.get(name, 0.0))
        return found

    @cached_property
    def traces(self) -> Mapping[str, Effect]:
        """The most of every effect that a machine may have without a word."""
        kinds = [kind for kind in self.kinds if not kind.calibrates and self.replaced_by(kind) is None]
        most = [kind.typical().scaled(BACKGROUND) for kind in kinds]
        shown = self.mean_squares([self.given.with_effect(item) for item in most], beside_values=False)
        factors = np.minimum(1.0, np.sqrt(TRACE / np.maximum(np.nan_to_num(shown, nan=math.inf), 1e-12)))
        return {item.name: item.scaled(float(factor)) for item, factor in zip(most, factors, strict=True)}

    def replaced_by(self, kind: type[Effect]) -> int | None:
        """Return the place of the known effect that an effect takes the place of."""
        known = enumerate(self.ready.nominal.drive.effects)
        return next((place for place, item in known if kind.in_place_of(item) is not None), None)

    # ---- drawing ----

    def draw(self, rng: np.random.Generator) -> Causes:
        """Draw a machine.

        Raises
        ------
        SimulationDiverged
            If too few of the drawn causes show in the motions.
        """
        shifts = np.clip(rng.standard_normal(len(self.given.shifts)), -2.0, 2.0)
        machine = self.given.moved(shifts)
        injected: dict[str, Effect] = {}
        sizes: dict[str, float] = {}
        n_causes = how_many(Tier.L, rng)[0]
        for _ in range(MOST_DRAWS):
            if len(injected) == n_causes:
                break
            offered = [kind for kind in self.kinds if kind.calibrates != "friction_form" and kind.name not in injected]
            kind = offered[int(rng.integers(len(offered)))]
            if any(self._clash(kind, type(other)) for other in injected.values()):
                continue
            effect, size = self._drawn(kind, rng)
            if size >= LEAST:
                injected[kind.name], sizes[kind.name] = effect, size
                machine = machine.with_effect(effect, self.replaced_by(kind))
        if len(injected) < n_causes:
            raise SimulationDiverged(f"{MOST_DRAWS} draws gave too few effects that show in these motions.")
        for name, trace in self.traces.items():
            if name not in injected:
                phases = {i.name: float(rng.uniform(-math.pi, math.pi)) for i in trace.parameters() if i.phase}
                machine = machine.with_effect(trace.changed(**phases).scaled(float(rng.uniform())))
        effects_alone = [name for name, effect in injected.items() if not effect.calibrates]
        hidden = effects_alone and rng.random() < TAKEN_OUT
        taken_out = (str(rng.choice(effects_alone)),) if hidden else ()
        return Causes(machine=machine, injected=injected, mean_squares=sizes, taken_out=taken_out)

    def _clash(self, kind: type[Effect], other: type[Effect]) -> bool:
        return any(
            self.replaced_by(a) is not None and (b.calibrates == "known_effects" or self.replaced_by(b) is not None)
            for a, b in ((kind, other), (other, kind))
        )

    def _drawn(self, kind: type[Effect], rng: np.random.Generator) -> tuple[Effect, float]:
        """Return an effect of drawn shape, and of a size by what it changes; that is 0 where it does not show."""
        place = self.replaced_by(kind)
        known = None if place is None else kind.in_place_of(self.ready.nominal.drive.effects[place])
        effect = kind(**drawn_shape(kind, known or kind.typical(), rng, SIZES if known is None else None))
        is_value = kind.name in self.deviations
        shown = self._shown(effect, is_value)
        if is_value:
            wanted = self.deviations[kind.name] * between(rng, *BEYOND) ** 2
        else:
            wanted = between(rng, LEAST, max(MOST * self.gap, 4.0 * LEAST))
        if shown == 0.0 or (known is not None and not is_value):
            return effect, shown
        # What a loop at its limits shows is not in proportion to the size of a cause, so one step may not do.
        for _ in range(1 if is_value else RESIZED):
            if shown <= wanted and not is_value:
                break
            effect = _bounded(effect, math.sqrt(wanted / shown))
            shown = self._shown(effect, is_value)
        return effect, shown

    def _shown(self, effect: Effect, is_value: bool) -> float:
        hypothesis = self.given.with_effect(effect, self.replaced_by(type(effect)))
        found = float(self.mean_squares([hypothesis], beside_values=not is_value)[0])
        return found if math.isfinite(found) else 0.0


def _bounded(effect: Effect, factor: float) -> Effect:
    """Return the effect with its amplitudes multiplied, as far as their bounds allow."""
    names = (effect.amplitude, *effect.further_amplitudes)
    return effect.within(**{name: factor * getattr(effect, name) for name in names})
