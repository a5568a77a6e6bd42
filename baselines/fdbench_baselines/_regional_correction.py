"""Correction by region of the motion: what `hybrid_regions` learns, foretells and stakes, as kernels."""

import numpy as np
from numba import njit

from fdbench.compilation import kept
from fdbench_baselines._recursive_least_squares import rls

REGIONS = 4
KEPT = 1.0 - 1.0 / 2000.0  # of the squares that the interval rests on, from a row to the next


@kept
@njit(error_model="numpy")
def means(left, regions, common):  # type: ignore[no-untyped-def]
    """Return the mean of what was left in each row's region before it, drawn to that of all by so many rows."""
    found, sums, counts, total = np.zeros(left.size), np.zeros(REGIONS), np.zeros(REGIONS), 0.0
    for k in range(left.size):
        r = regions[k]
        found[k] = (sums[r] + common * total / (k + common)) / (counts[r] + common)
        sums[r] += left[k]
        counts[r] += 1.0
        total += left[k]
    return found


@kept
@njit(error_model="numpy")
def follow(theta, x, q, limit):  # type: ignore[no-untyped-def]
    """Return the errors of a free run with some weights, none beyond a limit."""
    first = 2 + q
    p = theta.size - (1 + REGIONS) * first
    phi, before, run = np.empty(theta.size), np.zeros(p), np.empty(x.size)
    for k in range(x.size):
        fill(phi, x, k, q, before)
        run[k] = min(max(dot(theta, phi), -limit), limit)
        push(before, run[k])
    return run


@kept
@njit(error_model="numpy")
def quadrant(x, k):  # type: ignore[no-untyped-def]
    """Return the region of sample k of a response: 1 where it falls, and 2 more below zero."""
    return (1 if k > 0 and x[k] < x[k - 1] else 0) + (2 if x[k] < 0.0 else 0)


@kept
@njit(error_model="numpy")
def fill(phi, x, k, q, before):  # type: ignore[no-untyped-def]
    """Write the features of sample k: common ones, errors before, and the common ones in the place of the region."""
    first = 2 + q
    phi[:] = 0.0
    phi[0] = 1.0
    for i in range(min(q, k) + 1):
        phi[1 + i] = x[k - i]
    for i in range(before.size):
        phi[first + i] = before[i]
    at = first + before.size + quadrant(x, k) * first
    for i in range(first):
        phi[at + i] = phi[i]


@kept
@njit(error_model="numpy")
def dot(a, b):  # type: ignore[no-untyped-def]
    """Return the product of two vectors, summed in order."""
    total = 0.0
    for i in range(a.size):
        total += a[i] * b[i]
    return total


@kept
@njit(error_model="numpy")
def push(values, new):  # type: ignore[no-untyped-def]
    """Put a value before the others and drop the last."""
    for i in range(values.size - 1, 0, -1):
        values[i] = values[i - 1]
    if values.size > 0:
        values[0] = new


@kept
@njit(error_model="numpy")
def learn(x, e, begin, end, q, p, batch, ridge, narrower):  # type: ignore[no-untyped-def]
    """Return of samples from begin to end predicted errors, what weights and noise give as variance; weights (3, m)."""
    n, first, choices = e.size, 2 + q, narrower.size
    m = first + p + REGIONS * first
    theta, P = np.zeros((choices, m)), np.zeros((choices, m, m))
    for c in range(choices):
        for i in range(m):
            P[c, i, i] = (1.0 if i < first + p else narrower[c]) / ridge
    foretold, spread, loss = np.zeros(n), np.zeros(n), np.zeros(choices)
    noise, largest, phi, rows = 0.0, 0.0, np.empty(m), np.empty((batch, m))
    measured = np.zeros(p)
    for i in range(min(p, begin)):
        measured[i] = e[begin - 1 - i]
    for start in range(begin, end, batch):
        count = min(batch, end - start)
        best = np.argmin(loss)
        for c in range(choices):
            before, impulse, power = measured.copy(), np.zeros(p), 0.0
            for k in range(start, start + count):
                fill(phi, x, k, q, before)
                value = min(max(dot(theta[c], phi), -largest), largest)
                loss[c] += (e[k] - value) ** 2
                push(before, value)
                if c == best:
                    psi = 1.0 if k == start else dot(theta[c, first : first + p], impulse)
                    power = min(power + psi * psi, 1e12)
                    push(impulse, psi)
                    doubt = 0.0
                    for i in range(m):
                        if phi[i] != 0.0:
                            doubt += phi[i] * dot(P[c, i], phi)
                    foretold[k] = value
                    spread[k] = min(noise / max(start - begin, 1) * (power + doubt), largest * largest)
        for k in range(start, start + count):
            fill(rows[k - start], x, k, q, measured)
            push(measured, e[k])
            largest = max(largest, abs(e[k]))
        for c in range(choices):
            errors = rls(theta[c], P[c], rows[:count], e[start : start + count], 1.0)
            if c == best:
                noise += dot(errors, errors)
    return foretold, spread, theta


@kept
@njit(error_model="numpy")
def staked(foretold, e, batch):  # type: ignore[no-untyped-def]
    """Return the part of predicted errors that is added: at most what the batches before ask for, and have gained."""
    added, product, power, at_stake = np.zeros(e.size), 0.0, 0.0, 0.0
    for k in range(e.size):
        if k % batch == 0:
            at_stake = 0.0
            for i in range(max(k - batch, 0), k):
                product += foretold[i] * e[i]
                power += foretold[i] ** 2
        square = foretold[k] ** 2
        if product > 0.0 and square > 0.0:
            s = min(1.0, product / power, max(2.0 * product - power - at_stake, 0.0) / square)
            added[k] = s * foretold[k]
            at_stake += s * square
    return added


@kept
@njit(error_model="numpy")
def interval(left, spread, regions, batch):  # type: ignore[no-untyped-def]
    """Return the variances of what is left, from all before a batch; in the first one the mean square so far."""
    variance, sums, counts, squares = np.empty(left.size), np.zeros(REGIONS), np.zeros(REGIONS), 0.0
    total, number = 0.0, 0.0
    for k in range(left.size):
        if k % batch == 0:
            for i in range(max(k - batch, 0), k):
                sums *= KEPT
                counts *= KEPT
                total *= KEPT
                number *= KEPT
                if spread[i] > 0.0:
                    ratio = left[i] ** 2 / spread[i]
                    sums[regions[i]] += ratio
                    counts[regions[i]] += 1.0
                    total += ratio
                    number += 1.0
        squares += left[k] ** 2
        variance[k] = squares / (k + 1)
        if number > 0.0 and spread[k] > 0.0:
            r = regions[k]
            variance[k] = spread[k] * (sums[r] + batch * total / number) / (counts[r] + batch)
    return variance
