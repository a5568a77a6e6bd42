"""NARX model of what the data sheet's machine gets wrong, its terms chosen by orthogonal forward regression."""

import itertools
from typing import ClassVar, NamedTuple, final

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import PluginError, SpecError
from fdbench.estimator import BatchEstimator, Context, Estimate, FloatArray
from fdbench.record import Record
from fdbench_baselines._forward_regression import Terms, free_run, select
from fdbench_baselines._nominal_runs import DRIVES, nominal_runs, root_mean_square, unpredictable


class Learnt(NamedTuple):
    """What an axis has learnt: terms, and the sizes of error and inputs."""

    terms: Terms
    size: float
    scale: FloatArray


@final
class NarxFrols(BatchEstimator):
    r"""Nonlinear autoregressive model with exogenous inputs, of what a free run of the nominal machine leaves.

    .. math::
        y_k = \hat y_k + e_k, \qquad
        e_k = \sum_i w_i \, p_i(u_k, u_{k-d}, \ldots u_{k-Ld}) + \sum_{l=1}^{n_y} a_l \, e_{k-l} + \epsilon_k

    with the nominal machine's response :math:`\hat y` to the command and, as inputs u, what its equation multiplies on
    that run: on a drive commanded and own velocity or acceleration, velocity and direction, on a servo stage the
    response. The p are all products of up to ``degree`` of them, with delays; outputs enter linearly, since a free
    run of their products may diverge. Nothing measured is an input, so that training and free run see the same.

    Terms are chosen one by one by their error reduction ratio, each beside those before it (`_forward_regression`). A
    record says how well the next row is predicted, but a free run is asked for: how many terms, of which degree and
    with or without outputs is what makes the free runs err least on 30 % of the record at its end and at its start,
    which were not fitted; more has to lower the error by 3 %. No term at all is the data sheet.

    L, d and :math:`n_y` are those of the least mean logarithm of the free run's error on seeds 101 to 103 of six
    simulated scenarios (a servo stage's staircase and spiral, a ball screw, a shaker, two linear motors), out of 2, 4
    and 8, 2 and 4, 2, 4 and 10. No measured record was among them.

    Told: the data sheet. Claims nothing but the free run. Training costs O(n m^2) for n rows and m candidate terms: 50
    ms for m = 47; the memory is 40 n m bytes, 15 MB.

    Parameters
    ----------
    lags, stride : int
        L and d, in rows; at least 0 and at least 1.
    outputs : int
        :math:`n_y`, at least 0.
    degree : int
        1 to 3. Products cost 20 times as much at 2; while this was written, they bettered no scenario's free runs.
    terms : int
        Most terms of a model, at least 1.

    Raises
    ------
    SpecError
        If an argument is out of bounds.

    Validity
    --------
    A process force is no part of it: what goes with the feed, as a mean cutting force does, is learnt as if it were the
    machine's and is missing in air. A speed or direction that the record lacks is extrapolated by polynomials. Noise of
    the output is in :math:`e_{k-l}` and biases a towards 0, which is why models without outputs are tried too.

    References
    ----------
    Billings, Nonlinear System Identification: NARMAX Methods in the Time, Frequency, and Spatio-Temporal Domains, 2013,
    chapter 3; Chen, Billings and Luo, Orthogonal least squares methods and their application to non-linear system
    identification, International Journal of Control 50 (1989), 1873-1896. That free runs decide is ours, after Piroddi
    and Spinelli, International Journal of Control 76 (2003), 1767-1781; so are the sheet's run and its inputs.

    Examples
    --------
    The mass is 1.25 times that of the data sheet: an error of v that follows from the command.

    >>> from fdbench_baselines._example import example_drive
    >>> context, record = example_drive(mass_ratio=1.25)
    >>> estimator = NarxFrols(stride=1)
    >>> found = estimator.predict(context, estimator.fit(context, record), record)
    >>> bool(np.abs(found - record["velocity_m_per_s"][1:]).max() < 1e-3)
    True
    """

    made_for: ClassVar[tuple[str, ...] | None] = ("servo_response", *DRIVES)

    def __init__(self, lags: int = 8, stride: int = 2, outputs: int = 10, degree: int = 1, terms: int = 15) -> None:
        for name, value, least, most in (
            ("lags", lags, 0, 100),
            ("stride", stride, 1, 100),
            ("outputs", outputs, 0, 100),
            ("degree", degree, 1, 3),
            ("terms", terms, 1, 1000),
        ):
            if not isinstance(value, int) or not least <= value <= most:
                raise SpecError(f"narx_frols: {name} = {value!r} must be an integer from {least} to {most}.")
        self.lags, self.stride, self.outputs, self.degree, self.terms = lags, stride, outputs, degree, terms
        self._learnt: list[Learnt] | None = None

    def skip(self, context: Context) -> str | None:
        """Skip where no command makes the nominal model's target."""
        return unpredictable(context)

    def fit(self, context: Context, record: Record) -> Estimate:
        """Learn the error of each axis."""
        runs, learnt = nominal_runs(context, record, "narx_frols"), []
        for run, target in zip(runs, np.split(context.regression(record).target, len(runs)), strict=True):
            error = target - run.target
            size, scale = float(root_mean_square(error)), root_mean_square(run.inputs)
            known, degrees = self._known(run.inputs / scale)
            before = [np.append(np.zeros(lag), error[:-lag]) / size for lag in range(1, self.outputs + 1)]
            outputs = np.column_stack(before) if before else np.empty((len(error), 0))
            own = known.shape[1] + np.arange(self.outputs)
            simple = [np.flatnonzero(degrees <= degree) for degree in range(1, self.degree + 1)]
            allowed = [np.append(some, more) for some in simple for more in ((own[:0], own) if before else (own,))]
            learnt.append(Learnt(select(known, outputs, allowed, error / size, self.terms), size, scale))
        self._learnt = learnt
        return Estimate()

    def predict(self, context: Context, estimate: Estimate, command: Record) -> FloatArray | None:
        """Return the nominal machine's response to a command and the error that was learnt, both in a free run."""
        if self._learnt is None:
            raise PluginError("narx_frols: fit(context, record) must come before predict.")
        axes = []
        for run, (terms, size, scale) in zip(nominal_runs(context, command, "narx_frols"), self._learnt, strict=True):
            error = free_run(self._known(run.inputs / scale)[0], terms.columns, terms.weights)
            axes.append(run.target if error is None else run.target + size * error)
        return np.concatenate(axes)

    def _known(self, inputs: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
        """Return all products of delayed inputs (n, m), and how many factors each has (m,); before the first, rest."""
        n, delays = len(inputs), self.stride * np.arange(self.lags + 1)
        delayed = np.hstack([inputs[np.maximum(np.arange(n) - delay, 0)] for delay in delays])
        names = [
            name
            for degree in range(self.degree + 1)
            for name in itertools.combinations_with_replacement(range(delayed.shape[1]), degree)
        ]
        products = np.column_stack([np.prod(delayed[:, list(name)], axis=1) for name in names])
        return products, np.array([len(name) for name in names])
