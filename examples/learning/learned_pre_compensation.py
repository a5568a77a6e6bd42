"""A small learned agent for pre-compensation: a linear policy beside the inverse of the data sheet's model.

    python examples/learning/learned_pre_compensation.py

With the action a' of the inverse model (`reference_policies.py`), the action of an axis at the sample k is

    a_k = a'_k + w' phi_k

with features phi that a controller has online: errors up to the last sample behind four low passes; position, velocity
and direction of the reference now and ahead; and the first of these times the integral of its product with the error.
That integral adapts gain and friction within an episode by least mean squares (Widrow, Stearns, Adaptive Signal
Processing (1985)), and w holds its step.

The weights w are learned from the rewards of whole episodes alone by the cross-entropy method (Rubinstein, Kroese, The
Cross-Entropy Method (2004)): each generation tries normal weights on new seeds, and the best quarter gives mean and
deviation of the next one. It needs NumPy only.
"""

import argparse
import time
from typing import Any

import gymnasium
import numpy as np
from reference_policies import Inverse, compare

import fdbench  # noqa: F401 - registers the environments

# Trained on the key, judged on the values: spirals are learned on drawn machines, for the published one too.
JUDGED_ON = {
    "fdbench-drawn/ServoSpiral-v1": ("fdbench/ServoSpiral-v0", "fdbench-drawn/ServoSpiral-v1"),
    "fdbench/BallScrewAxis-v0": ("fdbench/BallScrewAxis-v0",),
}
LOW_PASS_S = np.array([0.0, 0.005, 0.02, 0.08])
AHEAD_S = (0.02, 0.04)
REVERSAL_M_PER_S = 2e-3
ADAPTED, ADAPTED_PER_S = 4, 10.0  # the first features of the reference, and how fast
GENERATIONS, CANDIDATES, ELITE = 15, 32, 8
FIRST_DEVIATION = 0.1  # of the weights; errors count in units of the action's scale, features of the reference up to 1


class Policy:
    """Inverse model and features of one environment, for lanes side by side that have weights of their own."""

    def __init__(self, env_id: str) -> None:
        env: Any = gymnasium.make(env_id, task="pre_compensation").unwrapped
        inverse = Inverse(env)
        self.env_id, self.drawn = env_id, bool(env.scenario.draw)
        self.scale, period_s = inverse.scale, env.interface.period_s
        self.forward = inverse(inverse.error) / self.scale
        self.reference, self.known = inverse.reference, features_of(inverse.reference, period_s)
        self.columns = [env.columns.index(env.system.columns[place]) for place in inverse.places]
        self.forgetting = 1.0 - np.exp(-period_s / np.maximum(LOW_PASS_S, 1e-9))
        self.gain = ADAPTED_PER_S * period_s
        self.shape = (self.reference.shape[1], len(LOW_PASS_S) + ADAPTED + self.known.shape[2])

    def lanes(self, number: int) -> Any:
        """Return environments side by side; drawn machines that are no feed drives are stepped in turns."""
        mode = "sync" if self.drawn else "vector_entry_point"
        return gymnasium.make_vec(self.env_id, number, mode, task="pre_compensation")

    def squared_errors(self, envs: Any, weights: np.ndarray, seeds: list[int]) -> np.ndarray:
        """Return the mean squared error of an episode, um^2, for each lane with its weights (lanes, axes, features)."""
        envs.reset(seed=seeds)
        features = np.zeros((len(seeds), *self.shape))
        past, adapted, known = np.split(features, np.cumsum([len(LOW_PASS_S), ADAPTED]), axis=2)
        integral, total = np.zeros_like(adapted), np.zeros(len(seeds))
        for reference, ahead, forward in zip(self.reference, self.known, self.forward, strict=True):
            known[:], adapted[:] = ahead, integral * ahead[:, :ADAPTED]
            actions = np.clip(forward + (weights * features).sum(axis=2), -1.0, 1.0)
            observations, rewards, terminated, _, _ = envs.step(actions.astype(np.float32))
            if terminated.any():
                raise RuntimeError(f"{self.env_id}: a drive has left its limits.")
            total -= rewards
            error = (reference - observations[:, self.columns])[:, :, None] / self.scale
            past += self.forgetting * (error - past)
            integral += self.gain * error * ahead[:, :ADAPTED]
        return total / len(self.forward)


def features_of(reference: np.ndarray, period_s: float) -> np.ndarray:
    """Return what is known of a path (n_samples, axes), (n_samples, axes, features), each feature up to 1."""
    samples = np.arange(len(reference))
    velocity = np.gradient(reference, period_s, axis=0)
    features = [np.ones_like(reference), reference]
    for ahead_s in (0.0, *AHEAD_S):
        later = velocity[np.minimum(samples + round(ahead_s / period_s), samples[-1])]
        features += [later, np.tanh(later / REVERSAL_M_PER_S)]
    features.append(reference * np.abs(reference))
    return np.stack([feature / np.abs(feature).max(axis=0) for feature in features], axis=2)


def learn(policy: Policy, generations: int = GENERATIONS) -> np.ndarray:
    """Return the weights (axes, features) that the cross-entropy method ends with; its seeds begin at 0."""
    random = np.random.default_rng(0)
    machines = 2 if policy.drawn else 1
    envs = policy.lanes(CANDIDATES * machines)
    mean, deviation = np.zeros(policy.shape), np.full(policy.shape, FIRST_DEVIATION)
    for generation in range(generations):
        tried = mean + deviation * random.standard_normal((CANDIDATES, *policy.shape))
        seeds = [generation * machines + machine for _ in range(CANDIDATES) for machine in range(machines)]
        found = policy.squared_errors(envs, np.repeat(tried, machines, axis=0), seeds)
        # By its logarithm no single machine decides, which may be ten times worse than another.
        loss = np.log(found).reshape(CANDIDATES, machines).mean(axis=1)
        best = tried[np.argsort(loss)[:ELITE]]
        mean, deviation = best.mean(axis=0), best.std(axis=0)
    envs.close()
    return np.asarray(mean)


def judge(policy: Policy, weights: np.ndarray, seeds: range) -> np.ndarray:
    """Return the mean squared error of each seed, um^2."""
    envs = policy.lanes(len(seeds))
    found = policy.squared_errors(envs, np.broadcast_to(weights, (len(seeds), *policy.shape)), list(seeds))
    envs.close()
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first-seed", type=int, default=100, help="of those that judge; training has seeds below 30")
    parser.add_argument("--seeds", type=int, default=10, help="how many judge")
    given = parser.parse_args()
    seeds = range(given.first_seed, given.first_seed + given.seeds)
    for trained_on, judged_on in JUDGED_ON.items():
        begun = time.process_time()
        weights = learn(Policy(trained_on))
        print(f"learned on {trained_on} in {time.process_time() - begun:.0f} s of processor time")
        for env_id in judged_on:
            policy = Policy(env_id)
            found, inverse = (judge(policy, used, seeds) for used in (weights, np.zeros_like(weights)))
            errors_um = compare(env_id, seeds) | {"learned agent": float(np.sqrt(found.mean()))}
            print(env_id)
            for name, error_um in errors_um.items():
                print(f"  {name:32} {error_um:8.2f} um")
            print(f"  the agent is better than the inverse model on {(found < inverse).sum()} of {len(seeds)} seeds")


if __name__ == "__main__":
    main()
