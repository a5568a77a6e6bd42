"""Training of a neural state space, two states and eight neurons, beside jax-sysid, and the free runs of both.

Both are fitted to the first 70 % of one record of the staircase, from ten random starts each, with the same poles to
start from, the same inputs and as many steps of L-BFGS at most. Ours is drawn to its start and stopped by the withheld
rest; jax-sysid draws as strongly to zero, does not stop, and compiles anew in each training.
"""

from importlib import import_module

import numpy as np
from _measure import Burst, Racer, describe_machine, race
from fdbench_baselines._free_run_training import RIDGE, stopped_early
from fdbench_baselines._nominal_runs import known, nominal_runs, root_mean_square
from fdbench_baselines._recurrent_kernels import LEAST_DECAY
from fdbench_baselines.neural_state_space import NeuralStateSpace

from fdbench.estimator import FloatArray
from fdbench.scenario import load_scenario
from fdbench.statistics import rms

NEURONS, ITERATIONS, SEED = 8, 100, 200

SCENARIO = load_scenario("ServoStaircase-v1")
CONTEXT, COMMAND = SCENARIO.context(), SCENARIO.command()
RECORD, TRUTH = SCENARIO.observe(SEED)
RUN = nominal_runs(CONTEXT, RECORD, "benchmark")[0]
ERROR = CONTEXT.regression(RECORD).target - RUN.target
SIZE, SCALE = float(root_mean_square(ERROR)), root_mean_square(known(CONTEXT, RUN))
INPUTS, TARGET = known(CONTEXT, RUN) / SCALE, ERROR / SIZE
FITTED = int(0.7 * len(TARGET))
ERRORS: dict[str, list[float]] = {}
NETWORK = NeuralStateSpace(NEURONS).network(CONTEXT, 0, CONTEXT.sampling_time_s)


def validation() -> tuple[FloatArray, FloatArray]:
    """Return the nominal response to the validation command, and the inputs that go with it."""
    if COMMAND is None:
        raise ValueError("the scenario has no validation motion.")
    run = nominal_runs(CONTEXT, COMMAND, "benchmark")[0]
    return run.target, known(CONTEXT, run) / SCALE


def ours() -> Burst:
    rng = np.random.default_rng(0)
    weight = (np.arange(len(TARGET)) < FITTED).astype(np.float64)

    def burst() -> FloatArray:
        start = NETWORK.start(INPUTS.shape[1], rng)
        theta, _ = stopped_early(NETWORK, start, INPUTS, TARGET, weight, ITERATIONS)
        response, inputs = validation()
        return scored("fdbench", response + SIZE * NETWORK.run(theta, inputs))

    return burst


def jax_sysid() -> Burst:
    """Return the burst of the same model with free matrices, from the same poles and no effect of the neurons."""
    models, jnp = import_module("jax_sysid.models"), import_module("jax.numpy")
    m, rng = INPUTS.shape[1], np.random.default_rng(0)
    tangent, decay = float(NETWORK.tangents[0]), float(NETWORK.decays[0])
    angle = 2.0 * np.arctan(tangent)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    gain = decay / (1.0 + decay)

    def state(x, u, params):  # type: ignore[no-untyped-def]
        A, B, bias, fed, C, D, b, *_ = params
        return A @ x + gain * (B @ u + bias + fed @ jnp.tanh(C @ x + D @ u + b))

    def output(x, u, params):  # type: ignore[no-untyped-def]
        *_, C, D, b, through, offset, direct = params
        return x[:1] + through @ u + offset + direct @ jnp.tanh(C @ x + D @ u + b)

    def burst() -> FloatArray:
        width = np.sqrt(m + 3)
        inner = [rng.standard_normal(shape) / width for shape in ((NEURONS, 2), (NEURONS, m), (NEURONS,))]
        start = [turn / (1.0 + LEAST_DECAY + decay), np.zeros((2, m)), np.zeros(2), np.zeros((2, NEURONS)), *inner]
        start += [np.zeros((1, m)), np.zeros(1), np.zeros((1, NEURONS))]
        peer = models.Model(2, 1, m, state_fcn=state, output_fcn=output)
        peer.init(params=[jnp.asarray(values) for values in start], x0=jnp.zeros(2))
        peer.loss(rho_x0=0.0, rho_th=RIDGE, train_x0=False)
        peer.optimization(adam_epochs=0, lbfgs_epochs=ITERATIONS, iprint=-1)
        peer.fit(TARGET[:FITTED, None], INPUTS[:FITTED])
        response, inputs = validation()
        return scored("jax-sysid", response + SIZE * np.asarray(peer.predict(jnp.zeros(2), inputs)[0])[:, 0])

    return burst


def scored(name: str, found: FloatArray) -> FloatArray:
    """Keep the error of a free run in per cent, as the metric has it."""
    response = np.asarray(TRUTH.response)
    ERRORS.setdefault(name, []).append(100.0 * rms(found - response) / rms(response - response.mean()))
    return found


def main() -> None:
    describe_machine()
    scored("data sheet", validation()[0])
    race(
        f"neural state space, {FITTED} rows, {ITERATIONS} steps of L-BFGS at most: s a training",
        [
            Racer(name="fdbench", start=ours, bar=1.0),
            Racer(name="L-BFGS, with compiling", start=jax_sysid, peer="jax-sysid"),
        ],
        rounds=9,
        compare=None,
    )
    print("free run of the validation command, %: median of as many starts, least and most")
    for name, errors in ERRORS.items():
        print(f"{name}: {np.median(errors):.2f} ({min(errors):.2f} to {max(errors):.2f})")


if __name__ == "__main__":
    main()
