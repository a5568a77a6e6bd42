"""Tangents: of every kernel, of a stepper with effects at its ports, and of kernels unlike those of the library."""

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from rig import BALL_SCREW, LIBRARY, effect

from fdbench.effects import Effect, Port
from fdbench.effects._effect import kernel
from fdbench.errors import PluginError
from fdbench.motions.held_levels import HeldLevels
from fdbench.simulate.axis import Axis
from fdbench.simulate.system import FloatArray, Setup, Timing
from fdbench.simulate.tangents import LANES, tangent_kernel, tangents

BACK_AND_FORTH = HeldLevels(levels_m_per_s=(0.05, -0.05), hold_s=0.1, acceleration_limit_m_per_s2=5.0)


def differenced(function: Callable[[float], Any], step: float) -> FloatArray:
    """Return the derivative at 0 by central differences, extrapolated from two steps; its error is of fourth order."""

    def central(h: float) -> FloatArray:
        return np.asarray((np.array(function(h)) - np.array(function(-h))) / (2.0 * h))

    return (4.0 * central(0.5 * step) - central(step)) / 3.0


def along(kind: type[Effect], values: FloatArray, direction: FloatArray, share: float) -> Any:
    return kind.kernel.py_func(*(values + share * direction))


@pytest.mark.parametrize("kind", LIBRARY, ids=lambda kind: kind.name)
def test_a_kernel_has_the_tangents_of_its_differences(kind: type[Effect]) -> None:
    """At points of motion, where none of its branches meet; along one direction in all that moves at once."""
    rng, tangent = np.random.default_rng(1), tangent_kernel(kind).py_func
    n_before, n = (3 if kind.random else 2), len(kind.arguments())
    for velocity in (0.013, -0.031, 4e-4):
        through = 3.3e-5 if kind.port in (Port.MOTOR_ENCODER, Port.TABLE_SCALE) else 3.3
        given = {"t": 0.1137, "h": 1e-4, "x": 0.0137, "v": velocity, "u": through, "r": 0.4}
        named = {item.symbol: item.typical for item in kind.parameters()}
        values = np.array([0.0 if name in kind.states else (given | named)[name] for name in kind.arguments()])
        states = [name in kind.states for name in kind.arguments()]
        values[states] = 1e-7 * rng.standard_normal(sum(states))
        still = np.isin(np.arange(n), (0, 1, 5)[:n_before])
        direction = np.where(still, 0.0, rng.standard_normal(n) * np.maximum(np.abs(values), 1e-9))
        moved = [
            (value,) if fixed else (value, way) for value, way, fixed in zip(values, direction, still, strict=True)
        ]
        found = np.array(tangent(*(item for pair in moved for item in pair)))
        np.testing.assert_array_equal(found[::2], along(kind, values, direction, 0.0))
        expected = differenced(partial(along, kind, values, direction), 1e-4)
        if kind.name in ("encoder_quantisation", "scale_quantisation"):
            expected = direction[[4]]
        np.testing.assert_allclose(found[1::2], expected, rtol=1e-7, atol=1e-9 * np.abs(found[::2]).max())


def logged(effects: tuple[Effect, ...]) -> Axis:
    drive = dataclasses.replace(BALL_SCREW, effects=effects)
    timing = Timing(sampling_time_s=1e-3, duration_s=0.3, substeps=10)
    return drive.system(Setup(timing=timing, motion=BACK_AND_FORTH))


def rows(axis: Axis) -> FloatArray:
    axis.start([0])
    return axis.advance(axis.n_samples)[:, : len(axis.columns), 0]


def test_a_stepper_has_the_tangents_of_its_differences() -> None:
    """Effects at every port, and more directions than there are lanes."""
    effects = (
        effect("current_loop_lag"),
        effect("axial_compliance"),
        effect("motor_coulomb_friction", transition_velocity_m_per_s=5e-3),
        effect("stribeck_friction", transition_velocity_m_per_s=5e-3),
        effect("constant_force"),
        effect("inertia_mismatch"),
        effect("encoder_interpolation_error"),
        effect("lead_error"),
    )
    axis = logged(effects)
    places = [slot.parameter(0) for slot in axis.slots()] + [axis.slots()[3].parameter(index) for index in (1, 2)]
    assert len(places) > LANES
    directions = np.zeros((axis.initial.shape[1], len(places)))
    directions[places, range(len(places))] = axis.initial[0, places, 0]
    found = tangents(axis, directions)
    for number, direction in enumerate(directions.T):

        def moved(share: float, direction: FloatArray = direction) -> FloatArray:
            other = logged(effects)
            other._initial.values[0, :, 0] += share * direction
            return rows(other)

        expected = differenced(moved, 4e-3)
        error = np.linalg.norm(found[:, :, number] - expected, axis=0)
        assert (error <= 1e-6 * np.linalg.norm(expected, axis=0) + 1e-12).all()
        assert np.linalg.norm(expected) > 0.0


def test_an_encoder_that_counts_is_taken_for_one_that_does_not() -> None:
    friction = effect("motor_coulomb_friction", transition_velocity_m_per_s=5e-3)
    counting, plain = logged((friction, effect("encoder_quantisation", resolution_m=1e-9))), logged((friction,))
    found = []
    for axis in (counting, plain):
        direction = np.zeros((axis.initial.shape[1], 1))
        direction[axis.slots()[0].parameter(0)] = 1.0
        found.append(tangents(axis, direction)[:, list(axis.columns).index("motor_position_m"), 0])
    assert np.linalg.norm(found[0] - found[1]) < 1e-3 * np.linalg.norm(found[1])


@kernel
def cubed(x):  # type: ignore[no-untyped-def]
    return x**3


@kernel
def reduced(v):  # type: ignore[no-untyped-def]
    while v > 1.0:
        v -= 1.0
    return v


@dataclasses.dataclass(frozen=True, kw_only=True)
class Cubic(Effect):
    port = Port.TABLE_FORCE

    @kernel
    def kernel(t, h, x, v, u):  # type: ignore[no-untyped-def]
        """A force that nobody has."""
        force = 2.0
        if v > 0.0:
            force += cubed(v)
        else:
            force = -v
        return force, 0.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class Looping(Effect):
    port = Port.TABLE_FORCE

    @kernel
    def kernel(t, h, x, v, u):  # type: ignore[no-untyped-def]
        return reduced(v), 0.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class Indexing(Effect):
    port = Port.TABLE_FORCE

    @kernel
    def kernel(t, h, x, v, u):  # type: ignore[no-untyped-def]
        return (x, v)[0], 0.0


def test_a_kernel_may_branch_and_call_others() -> None:
    tangent = tangent_kernel(Cubic)
    assert tangent(0.0, 1e-4, 0.0, 0.0, 0.5, 2.0, 0.0, 0.0) == (2.125, 1.5, 0.0, 0.0)
    assert tangent(0.0, 1e-4, 0.0, 0.0, -0.5, 2.0, 0.0, 0.0) == (0.5, -2.0, 0.0, 0.0)


@pytest.mark.parametrize(("kind", "text"), [(Looping, r"while v > 1\.0"), (Indexing, r"\(x, v\)\[0\]")])
def test_what_has_no_rule_is_refused(kind: type[Effect], text: str) -> None:
    with pytest.raises(PluginError, match=text):
        tangent_kernel(kind)
