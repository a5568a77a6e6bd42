"""PPO (Schulman et al., 2017, of Stable-Baselines3) learns to hold a linear drive still under a shaker.

    pip install "stable-baselines3>=2.6"
    python examples/learning/ppo_disturbance_rejection.py

The drives are those of ``fdbench-drawn/ShakerConstant-v2``: each episode another machine under another shaker. Trained
on seeds from 0 on, judged on seeds from 1000 on, which no constant was chosen on either.
"""

import argparse
from collections import deque
from typing import Any

import gymnasium
import numpy as np

import fdbench  # noqa: F401 - registers the environments

ENV_ID = "fdbench-drawn/ShakerConstant-v2"
REMEMBERED = 12  # samples of 3 ms: two periods of the shaker
RESIDUAL_M_PER_S = 1e-4  # what the learner sees as 1
REACH = 0.05  # of the action's range, which is what it may use
REWARD_SCALE = 50.0
TRAINED_SEEDS, JUDGED_SEEDS = 1000, range(1000, 1010)


class Residuals(gymnasium.Wrapper):
    """Observe what the data sheet's model missed in the last samples: its mass, friction and gain are all it knows."""

    def __init__(self, env: Any) -> None:
        super().__init__(env)
        drive = env.unwrapped
        values = drive.scenario.linear_model.nominal_parameters(drive.interface.period_s)
        self.beta = np.array([values[f"beta_{n}"] for n in (1, 2, 3, 4)])
        self.velocity = drive.columns.index("velocity_m_per_s")
        self.reference = drive.columns.index("reference_velocity_m_per_s")
        self.scale = drive.interface.action_scale
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (REMEMBERED,), np.float32)
        self.generator = np.random.default_rng(0)

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        chosen = int(self.generator.integers(TRAINED_SEEDS)) if seed is None else seed
        observation, info = self.env.reset(seed=chosen, options=options)
        self.last = deque([0.0] * REMEMBERED, maxlen=REMEMBERED)
        self.predicted = float(observation[self.velocity])
        return np.array(self.last, dtype=np.float32), info

    def step(self, action: Any) -> Any:
        # The reading of this step was taken before the action: only the one of the next step shows what it did.
        used = np.asarray(REACH * np.clip(action, -1.0, 1.0), dtype=np.float32)
        observation, reward, terminated, truncated, info = self.env.step(used)
        velocity, reference = observation[self.velocity], observation[self.reference]
        self.last.append((velocity - self.predicted) / RESIDUAL_M_PER_S)
        command = reference + float(used[0]) * self.scale
        regressors = (command, velocity, -float(velocity > 1e-3), float(velocity < -1e-3))
        self.predicted = float(self.beta @ regressors)
        return np.array(self.last, dtype=np.float32), REWARD_SCALE * reward, terminated, truncated, info


def make(lane: int = 0) -> Residuals:
    env = Residuals(gymnasium.make(ENV_ID, task="disturbance_rejection"))
    env.generator = np.random.default_rng(lane)
    return env


def deviation_mm_per_s(policy: Any) -> float:
    """Return the root of the mean squared deviation over the judged seeds, whose episodes are equally long."""
    envs, rewards = [make() for _ in JUDGED_SEEDS], []
    seen = np.array([env.reset(seed=seed)[0] for env, seed in zip(envs, JUDGED_SEEDS, strict=True)])
    over = False
    while not over:
        steps = [env.step(action) for env, action in zip(envs, policy(seen), strict=True)]
        seen = np.array([step[0] for step in steps])
        rewards.append([step[1] / REWARD_SCALE for step in steps])
        over = any(step[2] or step[3] for step in steps)
    return float(np.sqrt(-np.mean(rewards)))


def main() -> None:
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import DummyVecEnv

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=200_000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    envs = DummyVecEnv([lambda lane=lane: make(lane) for lane in range(8)])
    model = PPO(
        "MlpPolicy",
        envs,
        gamma=0.8,  # an action is felt for few samples, from the next but one on
        gae_lambda=0.9,
        n_steps=1024,
        batch_size=512,
        n_epochs=5,
        learning_rate=1e-3,
        policy_kwargs={"net_arch": {"pi": [], "vf": [64]}, "log_std_init": -1.5},
        seed=arguments.seed,
        device="cpu",
    )
    before = deviation_mm_per_s(lambda seen: np.zeros((len(seen), 1)))
    print(f"zero action     {before:.4f} mm/s")
    print(f"before learning {deviation_mm_per_s(lambda seen: model.predict(seen, deterministic=True)[0]):.4f} mm/s")
    model.learn(arguments.steps)
    after = deviation_mm_per_s(lambda seen: model.predict(seen, deterministic=True)[0])
    print(f"after {arguments.steps} steps {after:.4f} mm/s: {100 * (1 - after / before):.0f} % less than zero action")


if __name__ == "__main__":
    main()
