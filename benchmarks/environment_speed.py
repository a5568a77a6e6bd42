"""Time of a step, a lane's step and a substep on one thread, with the bars and, in the same bursts, Gymnasium's CartPole.

Bursts of all cases take turns; the best wall time counts, with the best CPU time beside it. A burst spans whole chunks
of random numbers, so that drawing them is part of the figure.
"""

import dataclasses
from collections.abc import Callable
from time import perf_counter, process_time
from typing import Any

import gymnasium
import numpy as np

from fdbench.envs import register_all
from fdbench.scenario import Scenario, load_scenario
from fdbench.simulate.axis import CHUNK

ROUNDS = 40
LUGRE = "LinearMotorAxis-v0"  # two masses, cascade, LuGre, sinusoidal force, quantisation, dropped samples, noise
Burst = Callable[[], int]  # runs, and returns how many units it ran


def timed(name: str, **timing: Any) -> Scenario:
    scenario = load_scenario(name)
    assert scenario.timing is not None
    return dataclasses.replace(scenario, timing=dataclasses.replace(scenario.timing, **timing))


def long(name: str, substeps: int) -> Scenario:
    """Return a scenario with enough samples for all bursts."""
    period = load_scenario(name).context().sampling_time_s
    return timed(name, substeps=substeps, duration_s=(ROUNDS + 2) * CHUNK * period)


def steps(env: Any, action: Any, lanes: int = 1, n: int = CHUNK) -> Burst:
    env.reset(seed=0)

    def burst() -> int:
        step = env.step
        for _ in range(n):
            step(action)
        return n * lanes

    return burst


def make(name: str, substeps: int, unwrapped: bool = False) -> Burst:
    env = gymnasium.make(f"fdbench/{name}", scenario=long(name, substeps))
    return steps(env.unwrapped if unwrapped else env, np.zeros(1, dtype=np.float32))


def make_vector(name: str, substeps: int, lanes: int) -> Burst:
    envs = gymnasium.make_vec(f"fdbench/{name}", num_envs=lanes, scenario=long(name, substeps))
    return steps(envs, np.zeros((lanes, 1), dtype=np.float32), lanes)


def samples(name: str, substeps: int, lanes: int) -> Burst:
    system = long(name, substeps).system(lanes)
    system.start(list(range(lanes)))

    def burst() -> int:
        system.advance(CHUNK)
        return CHUNK * lanes

    return burst


def episode(name: str) -> Burst:
    system = timed(name, duration_s=20.0).system()

    def burst() -> int:
        system.start([0])
        system.advance(system.n_samples)
        return 1

    return burst


def cart_pole(lanes: int) -> Burst:
    if lanes == 1:
        env: Any = gymnasium.make("CartPole-v1").unwrapped
        env.reset(seed=0)

        def burst() -> int:
            for k in range(CHUNK):
                if env.step(k & 1)[2]:
                    env.reset(seed=0)
            return CHUNK

        return burst
    envs = gymnasium.make_vec("CartPole-v1", num_envs=lanes, vectorization_mode="vector_entry_point")
    return steps(envs, np.zeros(lanes, dtype=np.int64), lanes)


def best_times(bursts: dict[str, Burst]) -> dict[str, tuple[float, float]]:
    """Return best wall and CPU time of a unit in ns."""
    best = {name: (np.inf, np.inf) for name in bursts}
    for _ in range(ROUNDS):
        for name, burst in bursts.items():
            wall, cpu = perf_counter(), process_time()
            units = burst()
            wall, cpu = (perf_counter() - wall) / units * 1e9, (process_time() - cpu) / units * 1e9
            best[name] = min(best[name][0], wall), min(best[name][1], cpu)
    return best


def main() -> None:
    register_all()
    bars = {
        "env.step, make, 10 substeps": 2000.0,
        "vector env, 1024 lanes, 10 substeps": 150.0,
        "substep, alone": 80.0,
        "substep, 64 lanes": 15.0,
        "episode of 20 s": 20e6,
    }
    bursts: dict[str, Burst] = {
        "env.step, make, 10 substeps": make(LUGRE, 10),
        "env.step, unwrapped, 10 substeps": make(LUGRE, 10, unwrapped=True),
        "vector env, 64 lanes, 10 substeps": make_vector(LUGRE, 10, 64),
        "vector env, 1024 lanes, 10 substeps": make_vector(LUGRE, 10, 1024),
        "episode of 20 s": episode(LUGRE),
        "CartPole-v1, unwrapped": cart_pole(1),
        "CartPole-v1, vector, 1024 lanes": cart_pole(1024),
    }
    for name in ("BallScrewAxis-v0", "ShakerConstant-v0"):
        scenario = load_scenario(name)
        assert scenario.timing is not None
        n = scenario.timing.substeps
        bursts[f"{name}, make, {n} substeps"] = make(name, n)
        bursts[f"{name}, 1024 lanes, {n} substeps"] = make_vector(name, n, 1024)
    fine = {f"{lanes} {n}": samples(LUGRE, n, lanes) for lanes in (1, 64) for n in (10, 50)}
    best = best_times(bursts | fine)
    for label, lanes in (("substep, alone", 1), ("substep, 64 lanes", 64)):
        difference = [(best[f"{lanes} 50"][i] - best[f"{lanes} 10"][i]) / 40 for i in (0, 1)]
        best[label] = difference[0], difference[1]
    print(f"{'':38} {'wall ns':>11} {'CPU ns':>11} {'bar ns':>11}")
    for name, (wall, cpu) in best.items():
        if name not in fine:
            print(f"{name:38} {wall:11.1f} {cpu:11.1f} {bars.get(name, np.nan):11.0f}".replace("nan", "   "))
    one = best["CartPole-v1, unwrapped"][0] / best["env.step, make, 10 substeps"][0]
    many = best["CartPole-v1, vector, 1024 lanes"][0] / best["vector env, 1024 lanes, 10 substeps"][0]
    print(f"\nspeed as a multiple of CartPole's: {one:.2f} alone, {many:.2f} with 1024 lanes")


if __name__ == "__main__":
    main()
