"""Least squares and the null estimator: exact where they must be, honest about what they cannot know."""

from typing import cast

import numpy as np
import pytest
from fdbench_baselines.least_squares import LeastSquares
from fdbench_baselines.null import Null

from fdbench.errors import SpecError
from fdbench.estimator import Context, Estimate, Estimator, FloatArray, Regression
from fdbench.plants._plant import Plant
from fdbench.record import Record

pytestmark = pytest.mark.linear_algebra

BETA = np.array([0.8, 0.2, -3.0])
NAMES = ("beta_1", "beta_2", "beta_3")


class TablePlant:
    """What a context asks of a plant, with the linear model given."""

    def __init__(self, regression: Regression) -> None:
        self.table = regression

    def linear_model(self, name: str) -> "TablePlant":
        return self

    def regression(self, record: Record) -> Regression:
        return self.table

    def nominal_parameters(self, sampling_time_s: float) -> dict[str, float]:
        return dict.fromkeys(self.table.names, 1.0)


def estimate(estimator: Estimator, regressors: FloatArray, target: FloatArray, gain: float = -0.5) -> Estimate:
    """Fit read-only data, so that an estimator that changes its input fails."""
    n, p = regressors.shape
    time_s = np.linspace(0.0, 0.01 * (n - 1), n)
    columns = [np.array(values) for values in (regressors, target, time_s)]
    for values in columns:
        values.flags.writeable = False
    table = Regression(
        regressors=columns[0],
        target=columns[1],
        names=NAMES[:p],
        target_name="velocity_m_per_s",
        time_s=columns[2],
        rows=np.arange(n),
        disturbance_gain=gain,
    )
    context = Context(sampling_time_s=0.01, plant=cast(Plant, TablePlant(table)), model="table")
    assert estimator.skip(context) is None
    return estimator.fit(context, Record({"time_s": np.linspace(0.0, 1.0, 3)}))


def regressors(n: int = 200, seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).standard_normal((n, 3)) * [1.0, 1e-3, 20.0]


def given(part: FloatArray | None) -> FloatArray:
    assert part is not None
    return part


def parameters(result: Estimate) -> FloatArray:
    return np.array(list(result.parameters.values()))


def test_noise_free_data_are_fitted_exactly() -> None:
    z = regressors()
    result = estimate(LeastSquares(), z, z @ BETA)
    assert tuple(result.parameters) == NAMES
    np.testing.assert_allclose(parameters(result), BETA, rtol=1e-9)
    np.testing.assert_allclose(given(result.output), z @ BETA, rtol=1e-9)
    np.testing.assert_allclose(given(result.disturbance_N), 0.0, atol=1e-11)


def test_agrees_with_the_normal_equations() -> None:
    z = regressors()
    y = z @ BETA + 0.3 * np.random.default_rng(1).standard_normal(len(z))
    result = estimate(LeastSquares(), z, y)
    inverse = np.linalg.inv(z.T @ z)
    beta = inverse @ z.T @ y
    residual = y - z @ beta
    s2 = residual @ residual / (len(y) - 3)
    np.testing.assert_allclose(parameters(result), beta, rtol=1e-10)
    np.testing.assert_allclose(given(result.covariance), s2 * inverse, rtol=1e-8, atol=1e-12 * s2)
    np.testing.assert_allclose(given(result.output_variance), [s2 * (1 + row @ inverse @ row) for row in z], rtol=1e-10)
    np.testing.assert_allclose(given(result.disturbance_N), residual / -0.5, rtol=0, atol=1e-12)


def test_covariance_is_the_scatter_of_the_estimates() -> None:
    z = regressors(60)
    random = np.random.default_rng(2)
    runs = [estimate(LeastSquares(), z, z @ BETA + 0.3 * random.standard_normal(60)) for _ in range(400)]
    claimed = np.mean([given(run.covariance) for run in runs], axis=0)
    scatter = np.cov([parameters(run) for run in runs], rowvar=False)
    np.testing.assert_allclose(np.diag(scatter), np.diag(claimed), rtol=0.25)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda z: np.column_stack((z[:, 0], 4e-7 * z[:, 0], z[:, 2])), "beta_1, beta_2"),
        (lambda z: np.column_stack((z[:, 0], z[:, 1], 0.0 * z[:, 2])), "beta_3"),
        (lambda z: np.column_stack((z[:, 0], z[:, 1], 3.0 * z[:, 0] - 700.0 * z[:, 1])), "beta_1, beta_2, beta_3"),
    ],
    ids=["collinear", "zero", "sum"],
)
def test_parameters_that_cannot_be_identified_are_named(change: object, named: str) -> None:
    assert callable(change)
    z = change(regressors())
    with pytest.raises(SpecError, match=rf"regression: {named} cannot be identified"):
        estimate(LeastSquares(), z, z @ BETA)


def test_ill_conditioned_regressors_are_not_refused() -> None:
    z = regressors()
    z[:, 1] = z[:, 0] + 1e-4 * z[:, 1]
    np.testing.assert_allclose(parameters(estimate(LeastSquares(), z, z @ BETA)), BETA, rtol=1e-6)


def test_too_few_rows_are_refused() -> None:
    with pytest.raises(SpecError, match="3 rows for 3 parameters"):
        estimate(LeastSquares(), regressors(3), np.ones(3))


def test_null_repeats_the_data_sheet_and_the_previous_target() -> None:
    result = estimate(Null(), regressors(4), np.array([3.0, 1.0, 4.0, 1.0]))
    assert dict(result.parameters) == dict.fromkeys(NAMES, 1.0)
    np.testing.assert_array_equal(given(result.output), [3.0, 3.0, 1.0, 4.0])
    np.testing.assert_array_equal(given(result.disturbance_N), np.zeros(4))
    assert result.covariance is None
    assert result.output_variance is None
