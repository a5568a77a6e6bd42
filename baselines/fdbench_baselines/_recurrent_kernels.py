"""Free runs of small recurrent networks and their gradients by backpropagation through time, in plain loops.

Nothing here is summed in an order that a processor chooses, and tanh is our own: libm's last bit differs between
processors, and a training of many steps makes more of it.
"""

import math

import numpy as np
from numba import njit

from fdbench.compilation import kept

TAYLOR = tuple(1.0 / math.factorial(order) for order in range(14, -1, -1))
LEAST_DECAY = 1e-4  # of a state in a row


@kept
@njit(error_model="numpy")
def tanh(x):  # type: ignore[no-untyped-def]
    """Return tanh x within 1e-14, by a series of exp(x / 32) that is squared six times."""
    y = min(max(x, -16.0), 16.0) * 0.03125
    e = 0.0
    for coefficient in TAYLOR:
        e = e * y + coefficient
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    return 1.0 - 2.0 / (e + 1.0)


@kept
@njit(error_model="numpy")
def gated_forward(theta, units, inputs):  # type: ignore[no-untyped-def]
    """Return outputs (n,) of gated recurrent units from rest, and (n + 1, 5, units): h before a row, z, r, g, q."""
    n, m = inputs.shape
    W, R, C, D = gated_parts(theta, units, m)
    turned = R.T.copy()
    states, outputs = np.zeros((n + 1, 5, units)), np.zeros(n)
    a, q = np.empty(3 * units), np.empty(3 * units)
    for k in range(n):
        now, h = states[k], states[k, 0]
        a[:] = W[m]
        q[:] = 0.0
        for j in range(m):
            u = inputs[k, j]
            for i in range(3 * units):
                a[i] += u * W[j, i]
        for j in range(units):
            for i in range(3 * units):
                q[i] += h[j] * turned[j, i]
        for i in range(2 * units):
            a[i] = 0.5 + 0.5 * tanh(0.5 * (a[i] + q[i]))
        y = D[m]
        for i in range(units):
            now[1, i], now[2, i], now[4, i] = a[i], a[units + i], q[2 * units + i]
            now[3, i] = tanh(a[2 * units + i] + now[2, i] * now[4, i])
            states[k + 1, 0, i] = now[1, i] * h[i] + (1.0 - now[1, i]) * now[3, i]
            y += C[i] * states[k + 1, 0, i]
        for j in range(m):
            y += D[j] * inputs[k, j]
        outputs[k] = y
    return outputs, states


@kept
@njit(error_model="numpy")
def gated_backward(theta, units, inputs, states, slopes):  # type: ignore[no-untyped-def]
    """Return the gradient of a cost whose derivatives by the outputs are the slopes (n,)."""
    n, m = inputs.shape
    _, R, C, _ = gated_parts(theta, units, m)
    gradient = np.zeros(theta.size)
    dW, dR, dC, dD = gated_parts(gradient, units, m)
    dh, da, dq = np.zeros(units), np.empty(3 * units), np.empty(3 * units)
    for k in range(n - 1, -1, -1):
        h, z, r, g, q = states[k]
        after, slope = states[k + 1, 0], slopes[k]
        for j in range(m):
            dD[j] += slope * inputs[k, j]
        dD[m] += slope
        for i in range(units):
            dC[i] += slope * after[i]
            d = dh[i] + slope * C[i]
            da[i] = d * (h[i] - g[i]) * z[i] * (1.0 - z[i])
            da[2 * units + i] = d * (1.0 - z[i]) * (1.0 - g[i] * g[i])
            da[units + i] = da[2 * units + i] * q[i] * r[i] * (1.0 - r[i])
            dh[i] = d * z[i]
            dq[i], dq[units + i], dq[2 * units + i] = da[i], da[units + i], da[2 * units + i] * r[i]
        for j in range(m):
            u = inputs[k, j]
            for i in range(3 * units):
                dW[j, i] += u * da[i]
        for i in range(3 * units):
            dW[m, i] += da[i]
            for j in range(units):
                dR[i, j] += dq[i] * h[j]
                dh[j] += dq[i] * R[i, j]
    return gradient


@kept
@njit(error_model="numpy")
def gated_parts(theta, units, m):  # type: ignore[no-untyped-def]
    """Return views of parameters: W (m + 1, 3 units) of the inputs and 1, R (3 units, units), C (units,), D (m + 1)."""
    first = 3 * units * (m + 1)
    second = first + 3 * units * units
    W = theta[:first].reshape((m + 1, 3 * units))
    R = theta[first:second].reshape((3 * units, units))
    return W, R, theta[second : second + units], theta[second + units :]


@kept
@njit(error_model="numpy")
def pole_parts(poles, decays, tangents):  # type: ignore[no-untyped-def]
    """Return real and imaginary parts of poles; see `NeuralStateSpace`."""
    tangent = tangents + decays * poles[1]
    size = 1.0 / (1.0 + LEAST_DECAY + decays * poles[0] * poles[0]) / (1.0 + tangent * tangent)
    return size * (1.0 - tangent * tangent), size * 2.0 * tangent


@kept
@njit(error_model="numpy")
def feedback_forward(theta, pairs, neurons, decays, tangents, inputs):  # type: ignore[no-untyped-def]
    """Return outputs (n,) of a linear system with a network in feedback, from rest; states x (n + 1, 2 pairs); w."""
    n, m = inputs.shape
    poles, B, Z, D = feedback_parts(theta, pairs, neurons, m)
    x, w, outputs = np.zeros((n + 1, 2 * pairs)), np.zeros((n, neurons)), np.zeros(n)
    real, imaginary = pole_parts(poles, decays, tangents)
    for k in range(n):
        now, after, z = x[k], x[k + 1], w[k]
        z[:] = Z[m]
        y = D[m]
        for j in range(m):
            u = inputs[k, j]
            y += D[j] * u
            for i in range(neurons):
                z[i] += u * Z[j, i]
            for i in range(2 * pairs):
                after[i] += u * B[j, i]
        for j in range(2 * pairs):
            for i in range(neurons):
                z[i] += now[j] * Z[m + 1 + j, i]
        for i in range(neurons):
            z[i] = tanh(z[i])
        for j in range(neurons):
            y += D[m + 1 + j] * z[j]
            for i in range(2 * pairs):
                after[i] += z[j] * B[m + 1 + j, i]
        for i in range(2 * pairs):
            after[i] = decays[i // 2] / (1.0 + decays[i // 2]) * (after[i] + B[m, i])
        for p in range(pairs):
            a, b = now[2 * p], now[2 * p + 1]
            y += a
            after[2 * p] += real[p] * a - imaginary[p] * b
            after[2 * p + 1] += imaginary[p] * a + real[p] * b
        outputs[k] = y
    return outputs, x, w


@kept
@njit(error_model="numpy")
def feedback_backward(theta, pairs, neurons, decays, tangents, inputs, x, w, slopes):  # type: ignore[no-untyped-def]
    """Return the gradient of a cost whose derivatives by the outputs are the slopes (n,)."""
    n, m = inputs.shape
    poles, B, Z, D = feedback_parts(theta, pairs, neurons, m)
    gradient = np.zeros(theta.size)
    dpoles, dB, dZ, dD = feedback_parts(gradient, pairs, neurons, m)
    back, driven, dz = np.zeros(2 * pairs), np.zeros(2 * pairs), np.empty(neurons)
    real, imaginary = pole_parts(poles, decays, tangents)
    for k in range(n - 1, -1, -1):
        now, slope = x[k], slopes[k]
        for i in range(2 * pairs):
            driven[i] = decays[i // 2] / (1.0 + decays[i // 2]) * back[i]
            dB[m, i] += driven[i]
        dD[m] += slope
        for j in range(m):
            dD[j] += slope * inputs[k, j]
            for i in range(2 * pairs):
                dB[j, i] += driven[i] * inputs[k, j]
        for j in range(neurons):
            dD[m + 1 + j] += slope * w[k, j]
            d = slope * D[m + 1 + j]
            for i in range(2 * pairs):
                d += driven[i] * B[m + 1 + j, i]
                dB[m + 1 + j, i] += driven[i] * w[k, j]
            dz[j] = d * (1.0 - w[k, j] * w[k, j])
        for j in range(m):
            for i in range(neurons):
                dZ[j, i] += inputs[k, j] * dz[i]
        for i in range(neurons):
            dZ[m, i] += dz[i]
        for p in range(pairs):
            a, b, da, db = now[2 * p], now[2 * p + 1], back[2 * p], back[2 * p + 1]
            along = real[p] * a - imaginary[p] * b
            across = imaginary[p] * a + real[p] * b
            slower, tangent = 2.0 * decays[p] * poles[0, p], tangents[p] + decays[p] * poles[1, p]
            dpoles[0, p] -= slower / (1.0 + LEAST_DECAY + 0.5 * slower * poles[0, p]) * (along * da + across * db)
            dpoles[1, p] += 2.0 * decays[p] / (1.0 + tangent * tangent) * (along * db - across * da)
            back[2 * p] = slope + real[p] * da + imaginary[p] * db
            back[2 * p + 1] = real[p] * db - imaginary[p] * da
        for j in range(2 * pairs):
            for i in range(neurons):
                dZ[m + 1 + j, i] += now[j] * dz[i]
                back[j] += Z[m + 1 + j, i] * dz[i]
    return gradient


@kept
@njit(error_model="numpy")
def feedback_parts(theta, pairs, neurons, m):  # type: ignore[no-untyped-def]
    """Return views of parameters: poles (2, pairs), B (m + 1 + neurons, 2 pairs), Z, D, of inputs, 1 and the rest."""
    states, first = 2 * pairs, 2 * pairs
    second = first + states * (m + 1 + neurons)
    third = second + neurons * (m + 1 + states)
    B = theta[first:second].reshape((m + 1 + neurons, states))
    Z = theta[second:third].reshape((m + 1 + states, neurons))
    return theta[:first].reshape((2, pairs)), B, Z, theta[third:]
