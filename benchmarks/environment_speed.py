"""A step, a lane's step and a substep of the drives, beside Gymnasium's own, MuJoCo and gym-electric-motor.

All physics differ, so times are compared and nothing else. The first drive has two masses, a cascade at 1 kHz, LuGre
friction, a sinusoidal force, ten substeps a step and no noise; the scenarios as they are have noise, and a burst spans
a chunk of random numbers, so that it holds their drawing. MuJoCo's two masses have a spring and dry friction.
"""

import dataclasses
import warnings
from functools import partial
from importlib import import_module
from typing import Any

import gymnasium
import numpy as np
from _measure import Burst, Racer, describe_machine, race

from fdbench.envs import environment_ids, register_all
from fdbench.scenario import Reality, Scenario, load_scenario
from fdbench.simulate.random import CHUNK

ROUNDS = 25
LANES = 1024
FEW = 64  # steps of a burst where every scenario is measured
SUBSTEPS = 200  # so many that the work of a sample does not count
DRIVE = "fdbench/BallScrewAxis-v0"  # the argument scenario overrides its scenario
SCREW_MJCF = """
<mujoco>
  <option timestep="1e-4" integrator="implicitfast" gravity="0 0 0"><flag contact="disable"/></option>
  <worldbody>
    <body>
      <joint name="motor" type="slide" axis="1 0 0" frictionloss="50" damping="100"/> <geom size="0.1" mass="30"/>
    </body>
    <body>
      <joint name="table" type="slide" axis="1 0 0" frictionloss="70"/> <geom size="0.1" mass="200"/>
    </body>
  </worldbody>
  <tendon>
    <fixed stiffness="1e8" damping="1e3"><joint joint="motor" coef="1"/><joint joint="table" coef="-1"/></fixed>
  </tendon>
  <actuator><motor joint="motor"/></actuator>
</mujoco>
"""


def lugre(substeps: int = 10) -> Scenario:
    """Return the drive of the bars."""
    scenario = endless("BallScrewAxis-v0", substeps=substeps)
    return dataclasses.replace(scenario, reality=Reality(effects=load_scenario("ShakerConstant-v0").reality.effects))


def endless(name: str, **timing: Any) -> Scenario:
    """Return a scenario with another clock, and enough samples for all bursts."""
    scenario = load_scenario(name)
    changed: Any = dataclasses.replace(scenario.setup.timing, **timing)
    changed = dataclasses.replace(changed, duration_s=(ROUNDS + 2) * CHUNK * changed.sampling_time_s)
    return dataclasses.replace(scenario, timing=changed)


def steps(env: Any, n: int = CHUNK) -> Burst:
    """Return a burst of steps without action, or left and right in turns; an episode that has ended starts again."""
    env.reset(seed=0)
    space = env.action_space
    actions = [k % 2 if isinstance(space, gymnasium.spaces.Discrete) else np.zeros_like(space.low) for k in range(n)]

    def burst() -> None:
        step = env.step
        for action in actions:
            _, _, terminated, truncated, _ = step(action)
            if terminated or truncated:
                env.reset()

    return burst


def lane_steps(envs: Any, n: int = CHUNK) -> Burst:
    envs.reset(seed=0)
    action = np.zeros_like(envs.action_space.sample())

    def burst() -> None:
        step = envs.step
        for _ in range(n):
            step(action)

    return burst


def one(scenario: Scenario) -> Burst:
    return steps(gymnasium.make(DRIVE, scenario=scenario))


def many(scenario: Scenario) -> Burst:
    return lane_steps(gymnasium.make_vec(DRIVE, num_envs=LANES, scenario=scenario))


def cart_poles(n: int = CHUNK) -> Burst:
    return lane_steps(gymnasium.make_vec("CartPole-v1", num_envs=LANES, vectorization_mode="vector_entry_point"), n)


def samples(scenario: Scenario, lanes: int) -> Burst:
    system = scenario.system(lanes)

    def burst() -> None:
        system.start(list(range(lanes)))
        system.advance(CHUNK)

    return burst


def mujoco_env(name: str, n: int) -> Burst:
    import_module("mujoco")  # gymnasium reports its absence by an error of its own
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return steps(gymnasium.make(name), n)


def electric_motor(n: int) -> Burst:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return steps(import_module("gym_electric_motor").make("Cont-SC-SeriesDc-v0"), n)


def mujoco_masses(n: int) -> Burst:
    mujoco = import_module("mujoco")
    model = mujoco.MjModel.from_xml_string(SCREW_MJCF)
    data = mujoco.MjData(model)
    data.ctrl[0] = 200.0
    return lambda: mujoco.mj_step(model, data, n)


def alone(name: str, start: Any, peer: str = "", note: str = "", bar: float = np.inf, n: int = CHUNK) -> Racer:
    return Racer(name=name, start=start, units=n, peer=peer, note=note, bar=bar)


def main() -> None:
    register_all()
    describe_machine()
    table = partial(race, rounds=ROUNDS, compare=None)
    table(
        "env.step, one environment: us a step",
        [
            alone("fdbench, 10 substeps, no noise", lambda: one(lugre()), bar=2.0),
            *(
                alone(f"fdbench, {name}", partial(lambda name: one(endless(name)), name), note=substeps(name))
                for name in ("BallScrewAxis-v0", "LinearMotorAxis-v0", "ShakerConstant-v0")
            ),
            alone("CartPole-v1", lambda: steps(gymnasium.make("CartPole-v1")), "gymnasium", "1 substep"),
            alone("Pendulum-v1", lambda: steps(gymnasium.make("Pendulum-v1")), "gymnasium", "1 substep"),
            alone(
                "InvertedPendulum-v5",
                lambda: mujoco_env("InvertedPendulum-v5", 200),
                "mujoco",
                "2 substeps, falls",
                n=200,
            ),
            alone("Swimmer-v5", lambda: mujoco_env("Swimmer-v5", 200), "mujoco", "4 substeps", n=200),
            alone("Cont-SC-SeriesDc-v0", lambda: electric_motor(200), "gym-electric-motor", "SciPy's solver", n=200),
        ],
        scale=1e6,
    )
    table(
        f"env.step, {LANES} environments side by side: ns a lane's step",
        [
            Racer(name="fdbench, 10 substeps, no noise", start=lambda: many(lugre()), units=LANES * CHUNK, bar=150.0),
            *(
                Racer(
                    name=f"fdbench, {name}",
                    start=partial(lambda name: many(endless(name)), name),
                    units=LANES * CHUNK,
                    note=substeps(name),
                )
                for name in ("BallScrewAxis-v0", "LinearMotorAxis-v0", "ShakerConstant-v0")
            ),
            Racer(
                name="CartPole-v1, its vector class",
                start=cart_poles,
                units=LANES * CHUNK,
                peer="gymnasium",
                note="1 substep",
            ),
        ],
        scale=1e9,
    )
    # Less than an episode of any of them, so that none is reset; `FEW` steps draw no random numbers, `CHUNK` do.
    race(
        f"every scenario, {LANES} environments side by side: ns a substep of a lane",
        [
            *(
                Racer(
                    name=f"fdbench, {name}",
                    start=partial(lambda name: lane_steps(gymnasium.make_vec(name, num_envs=LANES), FEW), env_id),
                    units=LANES * FEW * load_scenario(name).setup.timing.substeps,
                    note=substeps(name),
                )
                for env_id in environment_ids()
                for name in [env_id.removeprefix("fdbench/")]
            ),
            Racer(
                name="fdbench, ServoSpiral-v0, numbers drawn",
                start=lambda: lane_steps(gymnasium.make_vec("fdbench/ServoSpiral-v0", num_envs=LANES)),
                units=LANES * CHUNK * load_scenario("ServoSpiral-v0").setup.timing.substeps,
                note=substeps("ServoSpiral-v0"),
                bar=15.0,
            ),
            Racer(
                name="CartPole-v1, its vector class",
                start=partial(cart_poles, FEW),
                units=LANES * FEW,
                peer="gymnasium",
                note="1 substep",
            ),
        ],
        scale=1e9,
        rounds=5,
        compare=None,
    )
    table(
        "whole trials without an environment: ns a substep",
        [
            Racer(name="fdbench, alone", start=lambda: samples(lugre(SUBSTEPS), 1), units=SUBSTEPS * CHUNK, bar=80.0),
            Racer(
                name="fdbench, 64 lanes",
                start=lambda: samples(lugre(SUBSTEPS), 64),
                units=64 * SUBSTEPS * CHUNK,
                bar=15.0,
            ),
            alone("two masses, mj_step", lambda: mujoco_masses(1000), "mujoco", "dry friction", n=1000),
        ],
        scale=1e9,
    )


def substeps(name: str) -> str:
    return f"{load_scenario(name).setup.timing.substeps} substeps, noise"


if __name__ == "__main__":
    main()
