"""Look-alikes beside traces: what each leaves where a little of every other effect may be there, as in any machine."""

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fdbench.diagnosis.evidence.evidence import gather, summed
from fdbench.diagnosis.evidence.least_squares import solved
from fdbench.diagnosis.model.candidates import one_of_each
from fdbench.diagnosis.model.hypothesis import Hypothesis, at_bound
from fdbench.diagnosis.search.refinement import Refinement, Tangent
from fdbench.diagnosis.search.stage import Rival
from fdbench.diagnosis.settings import JUDGE, SEARCH
from fdbench.effects import Effect
from fdbench.record import FloatArray


def beside_traces(refinement: Refinement, rivals: Sequence[Rival]) -> tuple[FloatArray, NDArray[np.bool_]]:
    r"""Return what each of several look-alikes leaves in each stretch of time beside traces, and which ones imitate.

    With the weighted gap r of a look-alike, the responses X to what nominal parameters, its own size and a trace of
    each other effect change, and the priors P of these,

    .. math:: \min_\theta |r - X\theta|^2 + \theta^T P \theta

    at the best of its shapes. What is too small to be found changes readings by as much as look-alikes differ, and is
    no error that they have in common: a lag passes less of what is fast than a dead time, and so does a screw that is
    a little softer. Traces have a standard deviation of ``JUDGE.hidden`` of the typical size.

    Parameters
    ----------
    refinement : Refinement
    rivals : sequence of Rival
        The closest first; the others differ by little from it.

    Returns
    -------
    squares : (n_stretches, n_rivals) array
        Weighted squared gaps.
    imitating : (n_rivals,) array of bool
        Whether the best shape is near a bound of the form.
    """
    closest, kinds = rivals[0].hypothesis, {rival.kind.declared for rival in rivals}
    values = _tangent(closest, [kind not in kinds for kind, _ in _numbers(closest)])
    sizes, shapes = [_size(rival) for rival in rivals], [_shapes(rival) for rival in rivals]
    traces = [item for item in one_of_each(closest) if item.effects[-1].declared not in kinds]
    parts = [values, *sizes, *(Tangent(about=[closest] * len(each), moved=each) for each in (traces, *shapes))]
    ends = np.cumsum([1, *(len(part.moved) for part in parts)])
    of_values, *places = (np.arange(first, last) for first, last in itertools.pairwise(ends))
    of_sizes, of_traces, of_shapes = places[: len(rivals)], places[len(rivals)], places[len(rivals) + 1 :]
    about, moved = [item for part in parts for item in part.about], [item for part in parts for item in part.moved]
    evidence = gather(refinement.readings, refinement.split, closest, moved, about=about)
    sums, prior, stands = evidence.sums.sum(axis=0), np.zeros(ends[-1]), np.zeros(ends[-1])
    of_priors = of_values[: len(closest.shifts)]
    prior[of_priors], stands[of_priors], prior[of_traces] = 1.0, closest.shifts, JUDGE.hidden**-2

    def left_by(shape: int, columns: NDArray[np.intp]) -> tuple[float, FloatArray]:
        """Return the objective of a shape where columns are fitted beside it, and what of all columns is left then."""
        left = np.zeros(ends[-1])
        left[0], left[shape] = 1.0, -1.0
        normal = sums[np.ix_(columns, columns)] + np.diag(prior[columns])
        left[columns] = -solved(normal, sums[columns] @ left - prior[columns] * stands[columns])
        return float(left @ sums @ left + prior[columns] @ (stands[columns] - left[columns]) ** 2), left

    squares, imitating = [], []
    for number, own in enumerate(of_shapes):
        columns = np.concatenate([of_values, of_sizes[number], of_traces])
        fits = {place: left_by(shape, columns) for place, shape in enumerate(own) if not evidence.lost[shape]}
        best = min(fits, key=lambda place: fits[place][0])
        _, left = fits[best]
        squares.append(np.einsum("i,sij,j->s", left, evidence.products, left, optimize=True))
        effect = shapes[number][best].effect_of(rivals[number].kind)
        imitating.append(bool(at_bound(effect, SEARCH.imitates)))
    return summed(np.stack(squares, axis=1) * evidence.weights[:, None], evidence.group), np.array(imitating)


def _numbers(hypothesis: Hypothesis) -> list[tuple[type[Effect] | None, str]]:
    """Return the class of the effect and the name of each number of a hypothesis, None for a nominal parameter."""
    of_effects = [(effect.declared, item.name) for effect in hypothesis.effects for item in hypothesis.numbers(effect)]
    return [*[(None, "")] * len(hypothesis.shifts), *of_effects]


def _tangent(hypothesis: Hypothesis, chosen: Sequence[bool]) -> Tangent:
    """Return that of the chosen numbers of a hypothesis."""
    return Tangent.at(hypothesis).of(np.flatnonzero(chosen).tolist())


def _size(rival: Rival) -> Tangent:
    """Return that of what the effect of a look-alike has besides the parameters of its shape."""
    own, shape = rival.hypothesis, _searched(rival.kind)
    return _tangent(own, [kind is rival.kind.declared and name not in shape for kind, name in _numbers(own)])


def _searched(kind: type[Effect]) -> list[str]:
    """Return the parameters of the shape of an effect."""
    return [item.name for item in kind.parameters() if item.grid]


def _shapes(rival: Rival) -> list[Hypothesis]:
    """Return a look-alike as it is, and at points of all shapes that its effect may have."""
    names = _searched(rival.kind)
    bounds = [(item.low, item.high) for item in rival.kind.parameters() if item.name in names]
    points = itertools.product(*(np.linspace(*bound, SEARCH.shapes).tolist() for bound in bounds))
    others = [rival.effect.within(**dict(zip(names, point, strict=True))) for point in points if names]
    return [rival.hypothesis, *map(rival.hypothesis.with_effect, others)]
