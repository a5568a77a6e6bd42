"""Force-balance check: how much of the inverse-dynamics residual each rival explains, whatever the controller is.

Simulated signatures pass through the nominal controller. The force balances on motor and table
hold for whatever controller: they tell a cause from what a wrong loop makes of it.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft

from fdbench.diagnosis.evidence.inverse_dynamics import inverse_dynamics_residuals
from fdbench.diagnosis.evidence.least_squares import distance, solved
from fdbench.diagnosis.evidence.segment_products import HUGE
from fdbench.diagnosis.evidence.split import Split
from fdbench.diagnosis.judge.localise import PHASES, phase_of
from fdbench.diagnosis.model.readings import Readings
from fdbench.diagnosis.search.stage import Stage
from fdbench.diagnosis.settings import JUDGE
from fdbench.effects import Effect
from fdbench.record import FloatArray

MOVING = PHASES.index("acceleration")  # first of the phases in which the friction that holds an axis plays no part


def silenced(signals: Mapping[str, FloatArray]) -> NDArray[np.bool_]:
    """Set to zero, in place and in all channels, what diverges of gaps and changes; return which rows these are."""
    squares = [np.einsum("ij,ij->i", values, values) for values in signals.values()]
    lost = np.asarray(~np.logical_and.reduce([own < HUGE**2 for own in squares]))
    for values in signals.values():
        values[lost] = 0.0
    return lost


def force_balances_removed(readings: Readings, split: Split, contest: Stage) -> dict[type[Effect], float]:
    """Return the share of the squared held-out force balances that each rival of a contest removes.

    Their sizes and the nominal parameters are fitted anew, to the balances of the training segments and linearly from
    the nominal model: what a wrong loop made of them does not count. Samples at rest and near reversals do not
    either, where friction is whatever holds the axis.
    """
    rivals, nominal = contest.rivals, (0.0,) * len(contest.base.shifts)
    base, *others = (replace(item, shifts=nominal) for item in (contest.base, *(own.hypothesis for own in rivals)))
    shifted = base.moved_in_turn()
    lanes = [base, *shifted, *others]
    sums = np.zeros((2, len(lanes), len(lanes)))
    every = readings.roughly(base).each(dict.fromkeys(range(len(split.runs)), lanes), lent=True)
    for run, out, simulated in zip(split.runs, split.held_out, every, strict=True):
        changes = {name: values - values[0] for name, values in simulated.items()}
        for name, measured in run.channels.items():
            changes[name][0] = measured - simulated[name][0]
        silenced(changes)
        forces = smoothed(
            inverse_dynamics_residuals(run, changes, split.noise_models, base.nominal.drive), run.period_s
        )
        margin = round(JUDGE.force_balance_margin_s / run.period_s)
        inside = phase_of(run)[1:-2] >= MOVING
        inside[:margin] = inside[len(inside) - margin :] = False
        for part, judged in enumerate((~out[1:-2] & inside, out[1:-2] & inside)):
            chosen = forces[:, :, judged]
            sums[part] += run.repeats * np.einsum("bin,bjn->ij", chosen, chosen)
    nuisances = list(range(1, 1 + len(shifted)))
    alone = _left(sums, nuisances, len(shifted))
    left = [_left(sums, [*nuisances, 1 + len(shifted) + place], len(shifted)) for place in range(len(rivals))]
    return {rival.kind: 1.0 - own / alone if alone > 0.0 else 0.0 for rival, own in zip(rivals, left, strict=True)}


def _left(sums: FloatArray, columns: list[int], n_priors: int) -> float:
    """Return what the columns, fitted on the first sums, leave of the second."""
    normal, right = sums[0][np.ix_(columns, columns)], sums[0][columns, 0]
    normal[range(n_priors), range(n_priors)] += 1.0
    return distance(sums[1], columns, solved(normal, right))


def smoothed(forces: FloatArray, period_s: float) -> FloatArray:
    """Return forces low-passed without delay by a Gaussian that is down by 3 dB at ``JUDGE.force_balance_Hz``."""
    n = forces.shape[-1]
    length = next_fast_len(n, real=True)
    return np.asarray(irfft(rfft(forces, length) * low_pass(length, period_s), length)[..., :n])


def low_pass(n_samples: int, period_s: float) -> FloatArray:
    """Return the gains of that filter at the frequencies of a real spectrum, (n_samples / 2 + 1,)."""
    return np.asarray(np.exp(-0.5 * np.log(2.0) * (np.fft.rfftfreq(n_samples, period_s) / JUDGE.force_balance_Hz) ** 2))
