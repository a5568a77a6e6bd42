"""Policies without learning: feed-forward by the inverse of the data sheet's model, and iterative learning control.

    python examples/learning/reference_policies.py

Both give one action for each sample, computed before the episode. The model is the nominal plant without its frictions:
its response h to a held action is linear, and e is the error that is to be removed, reference minus reading,

    a = argmin |e - h * a|^2 + (damping |h| |a|)^2.

Inverse model (Okwudire, Ramani, Duan, CIRP Annals 65 (2016), 373-376, by B-splines there): e is that of the model, and
no machine is asked. Iterative learning control (Bristow, Tharayil, Alleyne, IEEE Control Systems Magazine 26 (2006),
96-114): e is that of the last trial on the machine, and a is added to its action.
"""

import argparse
import dataclasses
from typing import Any

import gymnasium
import numpy as np
from scipy import fft
from scipy.sparse.linalg import LinearOperator, lsqr

import fdbench  # noqa: F401 - registers the environments
from fdbench.simulate.system import Noise

DAMPING = 0.03  # of the inverse, relative to the model's gain; not tuned
TRIALS = 4


class Inverse:
    """The damped inverse of the data sheet's model, one axis of the machine after the other."""

    def __init__(self, env: Any) -> None:
        self.scale, logged, system = env.interface.action_scale, env.interface.task.logged, env.interface.system
        self.places = [place for _, _, place in logged]
        self.reference = np.column_stack([system.commanded[system.columns[wanted]] for _, wanted, _ in logged])
        plant, setup = env.scenario.plant, dataclasses.replace(env.scenario.setup, noise=Noise(), unmodelled=())
        if hasattr(plant, "effects"):
            plant = dataclasses.replace(plant, effects=())
        system = plant.system(setup)
        readings = []
        for action in (0.0, self.scale):
            system.start([0])
            readings.append(system.advance(system.n_samples, np.array([action]))[:, self.places, 0])
        self.error = self.reference - readings[0]
        self.response = np.diff(readings[1] - readings[0], axis=0, prepend=0.0) / self.scale

    def __call__(self, error: np.ndarray) -> np.ndarray:
        """Return the deviation of the commands (n_samples, n_axes), in m, that removes an error of that shape."""
        return np.column_stack([damped(h, e) for h, e in zip(self.response.T, error.T, strict=True)])


def damped(response: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Return the a that minimises the error beside the convolution, |e - h * a|, and its own size."""
    n = len(error)
    size = fft.next_fast_len(2 * n)
    spectrum = fft.rfft(response, size)
    model = LinearOperator(
        (n, n),
        matvec=lambda a: fft.irfft(spectrum * fft.rfft(a.ravel(), size), size)[:n],
        rmatvec=lambda e: fft.irfft(spectrum.conj() * fft.rfft(e.ravel(), size), size)[:n],
    )
    return np.asarray(lsqr(model, error, damp=DAMPING * abs(response.sum()), iter_lim=100)[0])


def episode(env: Any, seed: int, deviation: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the mean reward of an episode with these deviations of the commands, and its readings."""
    env.reset(seed=seed)
    actions = np.clip(deviation / env.interface.action_scale, -1.0, 1.0).astype(np.float32)
    rewards, rows = [], []
    for action in actions:
        observation, reward, terminated, _, _ = env.step(action)
        rewards.append(reward)
        rows.append(observation)
        if terminated:
            raise RuntimeError(f"seed {seed}: the drive has left its limits.")
    return float(np.mean(rewards)), np.array(rows)


def compare(env_id: str, seeds: range, trials: int = TRIALS) -> dict[str, float]:
    """Return the root of the mean squared error of each policy over seeds, um.

    Drawn machines have no learning control: with another seed a trial is another machine, with its own the same noise.
    """
    env: Any = gymnasium.make(env_id, task="pre_compensation").unwrapped
    inverse = Inverse(env)
    columns = [env.columns.index(env.system.columns[place]) for place in inverse.places]
    forward = inverse(inverse.error)
    policies = {"zero action": np.zeros_like(forward), "inverse model": forward}
    rewards = {name: [episode(env, seed, deviation)[0] for seed in seeds] for name, deviation in policies.items()}
    if not env.scenario.draw:
        name = f"learning control, after {trials} trials"
        deviation = policies["zero action"]
        for trial in range(trials):
            _, rows = episode(env, trial, deviation)
            deviation = deviation + inverse(inverse.reference - rows[:, columns])
        rewards[name] = [episode(env, seed, deviation)[0] for seed in seeds]
    return {name: float(np.sqrt(-np.mean(found))) for name, found in rewards.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--seeds",
        type=int,
        default=3,
        help="how many, from 100 on; the trials of learning control have those from 0 on",
    )
    seeds = range(100, 100 + parser.parse_args().seeds)
    for env_id in ("fdbench/ServoSpiral-v0", "fdbench-drawn/ServoSpiral-v1", "fdbench/BallScrewAxis-v0"):
        print(env_id)
        for name, error_um in compare(env_id, seeds).items():
            print(f"  {name:32} {error_um:8.2f} um")


if __name__ == "__main__":
    main()
