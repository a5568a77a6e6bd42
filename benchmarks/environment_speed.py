"""Time of a step, a lane's step and a substep on one thread, with the bars and, in turn, Gymnasium's CartPole.

Bursts of all cases take turns; the best wall time counts, with the best CPU time beside it. The case of the bars has no
noise; the scenarios below it have, and a burst spans a whole chunk of random numbers, so that it holds their drawing.
"""

import dataclasses
from collections.abc import Callable
from time import perf_counter, process_time
from typing import Any

import gymnasium
import numpy as np

from fdbench.envs import register_all
from fdbench.scenario import Reality, Scenario, load_scenario
from fdbench.simulate.axis import CHUNK

ROUNDS = 40
ANY = "fdbench/BallScrewAxis-v0"  # the argument scenario overrides its scenario
Burst = Callable[[], int]  # runs, and returns how many units it ran


def lugre(substeps: int = 10) -> Scenario:
    """Return the case of the bars: two masses, cascade at 1 kHz, LuGre friction, sinusoidal force, no noise."""
    scenario = with_timing("BallScrewAxis-v0", substeps=substeps)
    return dataclasses.replace(scenario, reality=Reality(effects=load_scenario("ShakerConstant-v0").reality.effects))


def with_timing(name: str, **timing: Any) -> Scenario:
    """Return a scenario with another clock, and enough samples for all bursts."""
    scenario = load_scenario(name)
    changed: Any = dataclasses.replace(scenario.setup.timing, **timing)
    changed = dataclasses.replace(changed, duration_s=(ROUNDS + 2) * CHUNK * changed.sampling_time_s)
    return dataclasses.replace(scenario, timing=changed)


def steps(env: Any, action: Any, lanes: int = 1, n: int = CHUNK) -> Burst:
    env.reset(seed=0)

    def burst() -> int:
        step = env.step
        for _ in range(n):
            step(action)
        return n * lanes

    return burst


def make(scenario: Scenario, unwrapped: bool = False) -> Burst:
    env = gymnasium.make(ANY, scenario=scenario)
    return steps(env.unwrapped if unwrapped else env, np.zeros(1, dtype=np.float32))


def make_vector(scenario: Scenario, lanes: int) -> Burst:
    envs = gymnasium.make_vec(ANY, num_envs=lanes, scenario=scenario)
    return steps(envs, np.zeros((lanes, 1), dtype=np.float32), lanes)


def samples(scenario: Scenario, lanes: int, n: int = CHUNK) -> Burst:
    system = scenario.system(lanes)

    def burst() -> int:
        system.start(list(range(lanes)))
        system.advance(n)
        return n * lanes

    return burst


def cart_pole(lanes: int) -> Burst:
    if lanes == 1:
        env: Any = gymnasium.make("CartPole-v1")
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
    best = dict.fromkeys(bursts, (np.inf, np.inf))
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
        "env.step, make": 2000.0,
        "vector env, 1024 lanes": 150.0,
        "substep, alone": 80.0,
        "substep, 64 lanes": 15.0,
        "episode of 20 s, a sample": 1000.0,
    }
    bursts: dict[str, Burst] = {
        "env.step, make": make(lugre()),
        "env.step, unwrapped": make(lugre(), unwrapped=True),
        "vector env, 64 lanes": make_vector(lugre(), 64),
        "vector env, 1024 lanes": make_vector(lugre(), 1024),
        "episode of 20 s, a sample": samples(lugre(), 1, 10_000),
        "CartPole-v1, make": cart_pole(1),
        "CartPole-v1, vector, 1024 lanes": cart_pole(1024),
    }
    for name in ("BallScrewAxis-v0", "LinearMotorAxis-v0", "ShakerConstant-v0"):
        scenario = with_timing(name)
        n = scenario.setup.timing.substeps
        bursts[f"{name}, make, {n} substeps"] = make(scenario)
        bursts[f"{name}, 1024 lanes, {n} substeps"] = make_vector(scenario, 1024)
    fine = {f"{lanes} {n}": samples(lugre(n), lanes) for lanes in (1, 64) for n in (10, 50)}
    best = best_times(bursts | fine)
    for label, lanes in (("substep, alone", 1), ("substep, 64 lanes", 64)):
        wall, cpu = ((best[f"{lanes} 50"][i] - best[f"{lanes} 10"][i]) / 40 for i in (0, 1))
        best[label] = wall, cpu
    print(f"{'':38} {'wall ns':>11} {'CPU ns':>11} {'bar ns':>11}")
    for name, (wall, cpu) in best.items():
        if name not in fine:
            print(f"{name:38} {wall:11.1f} {cpu:11.1f} {bars.get(name, np.nan):11.0f}".replace("nan", "   "))
    one = best["CartPole-v1, make"][1] / best["env.step, make"][1]
    many = best["CartPole-v1, vector, 1024 lanes"][1] / best["vector env, 1024 lanes"][1]
    print(f"\nspeed (CPU) as a multiple of CartPole's: {one:.2f} alone, {many:.2f} with 1024 lanes")


if __name__ == "__main__":
    main()
