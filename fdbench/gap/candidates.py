"""Candidates: every effect of the library at every point of its shape grid, as variants of a hypothesis."""

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from fdbench.effects import Effect, Port
from fdbench.gap.hypothesis import Hypothesis

QUARTER_TURN = math.pi / 2.0
LARGEST_CHANGE = 4.0


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """One effect at one point of its shape, added to a hypothesis.

    Attributes
    ----------
    members : tuple of Effect
        One effect, or two a quarter of a turn apart where a phase is free; their responses are combined linearly.
    replaces : int or None
        Index of the known effect that it takes the place of; a coefficient of 1 is then the whole replacement.
    """

    members: tuple[Effect, ...]
    replaces: int | None = None

    @property
    def kind(self) -> type[Effect]:
        """Class of the effect."""
        return type(self.members[0])

    @property
    def name(self) -> str:
        """Registered name of the effect."""
        return self.kind.name

    def hypotheses(self, base: Hypothesis) -> list[Hypothesis]:
        """Return the base with each member added."""
        return [base.with_effect(member, self.replaces) for member in self.members]

    def scaled(self, coefficients: Sequence[float]) -> "Candidate | None":
        """Return the candidate at the fitted amplitude and phase, as one effect; None where a bound is broken."""
        effect, kind = self.members[0], self.kind
        if self.replaces is not None:
            return self if 0.1 < coefficients[0] < 3.0 else None
        bounds = {item.name: item for item in kind.parameters()}
        value = getattr(effect, kind.amplitude)
        size = math.hypot(*coefficients) if len(coefficients) == 2 else coefficients[0]
        size = math.copysign(min(abs(size), LARGEST_CHANGE), size)
        item = bounds[kind.amplitude]
        if size * value < item.low:
            return None
        changes = {kind.amplitude: min(size * value, item.high)}
        if len(coefficients) == 2:
            phase = next(item.name for item in kind.parameters() if item.phase)
            turned = getattr(effect, phase) + math.atan2(coefficients[1], coefficients[0])
            changes[phase] = math.remainder(turned, 2.0 * math.pi)
        return Candidate(members=(dataclasses.replace(effect, **changes),))


def candidates(base: Hypothesis, located: Mapping[str, Sequence[float]]) -> list[Candidate]:
    """Return all candidates that may be added to a hypothesis.

    Parameters
    ----------
    located : mapping
        Values found in the residual for parameters to be located: ``"frequency"`` (Hz), ``"wavelength"`` (m).
    """
    present = {type(effect) for effect in base.effects}
    known = {type(effect) for effect in base.nominal.drive.effects}
    found: list[Candidate] = []
    for kind in base.nominal.library:
        if kind in present or (kind in known and not kind.calibrates):
            continue
        if kind.port is Port.TABLE_SCALE and base.nominal.drive.screw is None:
            continue
        found += _of_kind(base, kind, located)
    return found


def _of_kind(base: Hypothesis, kind: type[Effect], located: Mapping[str, Sequence[float]]) -> list[Candidate]:
    axes = []
    for item in kind.parameters():
        values = located.get(item.locate, ()) if item.locate else item.grid
        inside = [value for value in values if item.low <= value <= item.high]
        if inside:
            axes.append([(item.name, value) for value in inside])
    phase = next((item.name for item in kind.parameters() if item.phase), None)
    found = []
    for point in itertools.product(*axes):
        shape = dict(point)
        for index, known in enumerate(base.nominal.drive.effects):
            replacement = None if index in base.replaced else kind.in_place_of(known)
            if replacement is not None:
                found.append(Candidate(members=(dataclasses.replace(replacement, **shape),), replaces=index))
                break
        else:
            effect = kind.typical(**shape)
            if phase is None:
                found.append(Candidate(members=(effect,)))
            else:
                turned = [dataclasses.replace(effect, **{phase: angle}) for angle in (0.0, QUARTER_TURN)]
                found.append(Candidate(members=tuple(turned)))
    return found
