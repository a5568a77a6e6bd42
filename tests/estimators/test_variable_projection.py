"""Variable projection simulates the process as it is, and sees the run-out beside it."""

from dataclasses import replace

import numpy as np
import pytest
from fdbench_baselines._example import example_drive, example_milling
from fdbench_baselines.least_squares import LeastSquares
from fdbench_baselines.variable_projection import VariableProjection, propagators, responses
from scipy.integrate import solve_ivp

from fdbench.errors import SpecError
from fdbench.record import Record

PERIOD_S = 0.15


def test_responses_are_those_of_the_differential_equation() -> None:
    c_1, c_2, step_s, n = 3.3, 9.0, 0.01, 200

    def load(t: float) -> float:
        return 1.0 + 0.2 * np.sin(15.0 * t)

    def slope(t: float, x: np.ndarray) -> list[float]:
        return [-c_1 * x[0] + x[1] + c_1 * load(t), -c_2 * x[0] + c_2 * load(t)]

    time_s = step_s * np.arange(n)
    loads = np.array([load(t) for t in 0.5 * step_s * np.arange(2 * n - 1)])
    found = responses(propagators(c_1, c_2, step_s), loads)
    for column, start in ((found[:, 0], [0.0, 0.0]), (found[:, 0] + found[:, 2], [0.0, 1.0])):
        slow = solve_ivp(slope, (0.0, time_s[-1]), start, t_eval=time_s, rtol=1e-10, atol=1e-12).y[0]
        assert np.allclose(column, slow, rtol=0.0, atol=1e-5)


@pytest.mark.linear_algebra
def test_a_runout_leaves_the_parameters_alone_and_is_the_disturbance() -> None:
    context, record = example_milling()
    wave = 2.0 * np.sin(2.0 * np.pi * 1.003 * record["time_s"] / PERIOD_S + 1.0)
    noise = 1e-3 * np.random.default_rng(0).standard_normal(record.n_samples)
    shaken = Record(
        {name: record[name] for name in ("time_s", "feedrate_m_per_s")} | {"force_N": record["force_N"] + wave + noise}
    )
    context = replace(context, disturbance_period_s=PERIOD_S)
    found = VariableProjection().fit(context, shaken)
    true = np.array(list(context.nominal.values()))
    errors = np.array(list(found.parameters.values())) - true
    assert found.covariance is not None
    assert found.disturbance_N is not None
    assert np.all(np.abs(errors) < 4.0 * np.sqrt(np.diag(found.covariance)))
    assert np.max(np.abs(errors / true)) < 0.02
    assert np.allclose(found.disturbance_N, wave[2:], rtol=0.0, atol=2e-3)
    biased = np.array(list(LeastSquares().fit(context, shaken).parameters.values())) - true
    assert np.max(np.abs(biased / true)) > 0.2


def test_bad_input_is_refused() -> None:
    with pytest.raises(SpecError, match="variable_projection: harmonics = -1"):
        VariableProjection(-1)
    with pytest.raises(SpecError, match="the plant is no slot milling"):
        VariableProjection().fit(*example_drive())
