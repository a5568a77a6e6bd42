"""Candidates: every effect of the library at every point of its shape grid, as variants of a hypothesis."""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from fdbench.diagnosis.model.friction_parameters import BristleForm
from fdbench.diagnosis.model.hypothesis import Hypothesis
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.records.spectral_lines import highest_Hz
from fdbench.diagnosis.settings import MODEL
from fdbench.effects import Effect, Port

NEIGHBOUR = 3.0  # ratio of neighbouring speeds of a grid
QUARTER_TURN = math.pi / 2.0


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """One effect at one point of its shape, added to a hypothesis.

    Attributes
    ----------
    members : tuple of Effect
        One effect, two a quarter of a turn apart where a phase is free, or one for each of several amplitudes; their
        responses are combined linearly.
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
        """Return the candidate at the fitted amplitudes and phase, as one effect; None where a bound is broken."""
        effect, kind = self.members[0], self.kind
        if self.replaces is not None:
            return self if MODEL.least_replacement < coefficients[0] < MODEL.most_replacement else None
        changes: dict[str, float] = {}
        phase = phase_of(kind)
        members = list(self.members)
        if phase is not None and len(members) > 1 + len(kind.further_amplitudes):
            turned = getattr(effect, phase) + math.atan2(coefficients[1], coefficients[0])
            changes[phase] = math.remainder(turned, 2.0 * math.pi)
            coefficients = [math.hypot(*coefficients[:2]), *coefficients[2:]]
            del members[1]
        lowest = {item.name: item.low for item in kind.parameters()}
        for name, member, coefficient in zip(amplitudes(kind), members, coefficients, strict=False):
            size = math.copysign(min(abs(coefficient), MODEL.largest_change), coefficient)
            changes[name] = size * getattr(member, name)
            if changes[name] < lowest[name]:
                return None
        return Candidate(members=(effect.within(**changes),))

    def sizes(self, shares: Sequence[float]) -> "list[Candidate]":
        """Return the candidate at shares of its size; a replacement has no other size."""
        if self.replaces is not None:
            return [self]
        return [Candidate(members=tuple(member.scaled(share) for member in self.members)) for share in shares]


def middle_shapes(items: Iterable[Candidate]) -> list[Candidate]:
    """Return of each class of effect the candidate in the middle of its shapes."""
    found: dict[type[Effect], list[Candidate]] = {}
    for item in items:
        found.setdefault(item.kind, []).append(item)
    return [shapes[len(shapes) // 2] for shapes in found.values()]


def one_of_each(base: Hypothesis) -> list[Hypothesis]:
    """Return a hypothesis with each effect that it lacks, at a typical size and in the middle of its shapes."""
    added = (item for item in candidates(base) if item.replaces is None)
    return [item.hypotheses(base)[0] for item in middle_shapes(added)]


def amplitudes(kind: type[Effect]) -> tuple[str, ...]:
    """Return the parameters in which an effect is linear: its amplitude and further ones."""
    return (kind.amplitude, *kind.further_amplitudes)


def phase_of(kind: type[Effect]) -> str | None:
    """Return the name of the phase of an effect, if it has one."""
    return next((item.name for item in kind.parameters() if item.phase), None)


def with_other_numbers(effect: Effect) -> list[list[Effect]]:
    """Return an effect with each other whole number that is searched: at eight phases each, if it has one.

    Once with all else as it is, and once with the line that it was located by.
    """
    kind = type(effect)
    own = {item.name: float(getattr(effect, item.name)) for item in kind.parameters()}
    phase, located = phase_of(kind), [item.name for item in kind.parameters() if item.locate]
    found = []
    for item in kind.parameters():
        for number in item.grid if item.whole else ():
            if number == own[item.name]:
                continue
            of_own, of_number = (kind.shape({**own, item.name: value}) for value in (own[item.name], number))
            line = {name: own[name] * of_number[name] / of_own[name] for name in located}
            alike = [effect.changed(**{item.name: number}), effect.changed(**{item.name: number, **line})]
            found.append(alike if phase is None else [one for other in alike for one in turned(other, phase)])
    return found


def turned(effect: Effect, phase: str) -> list[Effect]:
    """Return an effect at eight values of a phase."""
    angles = (getattr(effect, phase) + turn * 0.5 * QUARTER_TURN for turn in range(8))
    return [effect.changed(**{phase: math.remainder(angle, 2.0 * math.pi)}) for angle in angles]


def candidates(
    base: Hypothesis, located: Mapping[str, Sequence[float]] | None = None, period_s: float | None = None
) -> list[Candidate]:
    """Return all candidates that may be added to a hypothesis.

    Not those whose size is a nominal parameter: re-calibration moves it in every hypothesis. Of what is known a machine
    may have another period besides, such as a further order of cogging.

    Parameters
    ----------
    located : mapping, optional
        Values found in the residual for parameters to be located: see `fdbench.diagnosis.search.periods`.
        Without, they are those of their grid, or typical.
    period_s : float, optional
        Sampling time of the records; no frequency above 0.8 of the Nyquist frequency is a candidate.
    """
    drive = base.nominal.drive
    present = {effect.declared for effect in base.effects}
    covered = {item.cause(base.nominal) for item in nominal_parameters(base.nominal)}
    found: list[Candidate] = []
    shown_Hz = math.inf if period_s is None else highest_Hz(period_s)
    for kind in base.nominal.library:
        unseen = drive.screw is None and (kind.port is Port.TABLE_SCALE or kind.needs_screw)
        known = [effect for effect in drive.effects if effect.declared is kind.declared]
        is_value = kind.name in covered and not known
        if kind.declared in present or is_value or unseen or BristleForm.is_carried_by(kind):
            continue
        found += [
            item
            for item in _of_kind(base, kind, located)
            if _fastest_Hz(item.members[0]) <= shown_Hz and all(_is_another(item.members[0], other) for other in known)
        ]
    return found


def _is_another(effect: Effect, known: Effect) -> bool:
    """Return whether an effect has another period than a known one of its kind."""
    return any(
        abs(getattr(effect, item.name) / getattr(known, item.name) - 1.0) > MODEL.another_period
        for item in type(effect).parameters()
        if item.locate
    )


def _fastest_Hz(effect: Effect) -> float:
    """Return the highest frequency of an effect that is searched, 0 where it has none."""
    searched = [item for item in effect.parameters() if item.unit == "Hz" and (item.grid or item.locate)]
    return max((float(getattr(effect, item.name)) for item in searched), default=0.0)


def _speeds(base: Hypothesis, grid: Sequence[float]) -> Sequence[float]:
    """Return a grid of speeds; of an axis far faster or slower than usual, also the same shares of its fastest."""
    nominal = base.nominal
    ratio = nominal.covered.fastest_m_per_s / (MODEL.usual_speed_m_per_s * nominal.scale.of("m/s"))
    is_usual = ratio == 0.0 or 1.0 / NEIGHBOUR < ratio < NEIGHBOUR
    return grid if is_usual else (*grid, *(value * ratio for value in grid))


def _of_kind(base: Hypothesis, kind: type[Effect], located: Mapping[str, Sequence[float]] | None) -> list[Candidate]:
    axes = []
    for item in kind.parameters():
        values: Sequence[float] = _speeds(base, item.grid) if item.unit == "m/s" else item.grid
        if item.locate:
            values = item.grid or (item.typical,) if located is None else located.get(item.locate, ())
        if item.locate or values:
            high = min(item.high, base.nominal.covered.most(item.unit))
            axes.append([(item.name, value) for value in values if item.low <= value <= high])
    phase, further = phase_of(kind), kind.further_amplitudes
    known = [(index, item) for index, item in enumerate(base.nominal.drive.effects) if index not in base.replaced]
    found = []
    for point in itertools.product(*axes):
        shape = kind.shape(dict(point))
        others = [(index, kind.in_place_of(item, shape)) for index, item in known]
        replacements = [Candidate(members=(other,), replaces=index) for index, other in others if other is not None]
        if replacements:  # an axis has either of them, not one beside the other
            found += replacements
            continue
        effect = kind.typical(**shape, **dict.fromkeys(further, 0.0))
        sets = [[effect]]
        if phase is not None and phase not in shape:
            sets = [[effect.changed(**{phase: angle}) for angle in (0.0, QUARTER_TURN)]]
            if kind.starts:  # what is not proportional to its size does not add up over phases either
                sets = [[item] for item in turned(effect, phase)]
        silent = effect.changed(**{kind.amplitude: 0.0})
        typical = kind.typical(**shape)
        parts = [silent.changed(**{name: getattr(typical, name)}) for name in further]
        found += [Candidate(members=(*members, *parts)) for members in sets]
    return found
