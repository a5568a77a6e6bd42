"""What follows from substep and parameters alone is computed once; a kernel in two parts is the kernel to the bit."""

import math
from dataclasses import dataclass
from typing import final

import numpy as np
import pytest

from fdbench.effects import Effect, Port, effects, kernel
from fdbench.effects._effect import parameter
from fdbench.simulate.invariants import parted


def named(name: str) -> type[Effect]:
    return effects.get(name)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("current_loop_lag", {}),
        ("current_loop_lag", {"inverter_ratio": 0.0}),
        ("current_loop_lag", {"inverter_ratio": 0.4}),
        ("current_loop_lag", {"time_constant_s": 0.0}),
        ("structural_mode", {}),
    ],
)
def test_the_two_parts_are_the_kernel_to_the_bit(name: str, changes: dict[str, float]) -> None:
    effect = named(name)
    parts = parted(effect)
    assert parts is not None
    values = effect.typical(**changes).values()
    h = 1e-4
    constants = parts.prepare(h, *values)
    assert len(constants) == len(parts.names)
    generator = np.random.default_rng(0)
    for t, x, v, u, *states in generator.standard_normal((20, 4 + len(effect.states))).tolist():
        expected = effect.kernel(t, h, x, v, u, *values, *states)
        assert parts.rest(t, h, x, v, u, *values, *constants, *states) == expected


def test_what_is_cheap_or_moves_stays_in_one_piece() -> None:
    assert [name for name in effects.names() if parted(named(name))] == ["current_loop_lag", "structural_mode"]


@final
@dataclass(frozen=True, kw_only=True)
class Early(Effect):
    """Reads a value before its last assignment."""

    port = Port.TABLE_FORCE
    amplitude = "size_N"
    size_N: float = parameter("a", low=0.0, high=1.0, typical=0.5)

    @kernel
    def kernel(t, h, x, v, u, a):
        scale = 1.0 / a
        first = scale * v
        scale = math.sqrt(a)
        return first + scale * v, 0.0


@final
@dataclass(frozen=True, kw_only=True)
class Whole(Effect):
    """Counts by a whole number that follows from a parameter."""

    port = Port.TABLE_FORCE
    amplitude = "size_N"
    size_N: float = parameter("a", low=0.0, high=9.0, typical=3.0)

    @kernel
    def kernel(t, h, x, v, u, a):
        n = int(a / 1.0)
        scale = math.sqrt(a)
        total = scale
        for _ in range(n):
            total += v
        return total, 0.0


@final
@dataclass(frozen=True, kw_only=True)
class Counted(Effect):
    """Sums as many harmonics as a number without a point says."""

    port = Port.TABLE_FORCE
    amplitude = "size_N"
    size_N: float = parameter("a", low=0.0, high=9.0, typical=3.0)

    @kernel
    def kernel(t, h, x, v, u, a):
        n, total = 3, 0.0
        scale = math.sqrt(a)
        for k in range(n):
            total += scale * v / (k + 1)
        return total, 0.0


@final
@dataclass(frozen=True, kw_only=True)
class Branched(Effect):
    """Assigns in a branch what it reads behind it."""

    port = Port.TABLE_FORCE
    states = ("z",)
    amplitude = "size_N"
    size_N: float = parameter("a", low=0.0, high=1.0, typical=0.5)

    @kernel
    def kernel(t, h, x, v, u, a, z):
        root = math.sqrt(a)
        rate = root / h
        if v > 0.0:
            root = 2.0 * root
        z, gain = z + rate * v, rate * 2.0
        return root * z + gain, 0.0, z


def test_values_that_cannot_be_handed_on_leave_a_kernel_whole() -> None:
    assert parted(Early) is None
    assert parted(Whole) is None
    assert parted(Counted) is None


def test_a_value_of_a_branch_stays_with_it() -> None:
    parts = parted(Branched)
    assert parts is None or "root" not in parts.names
