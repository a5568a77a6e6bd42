"""How what a feed drive logs moves with settings of its values: exactly, without a step."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fdbench.plants.feed_drive import FeedDrive, nominal_axis
from fdbench.record import FloatArray, Record
from fdbench.simulate.block import MECHANICS_ROWS, ROW
from fdbench.simulate.tangents import tangents

STEP = 1e-200  # along the imaginary axis: its square is 0


def sensitivities(
    drive_at: Callable[[NDArray[np.inexact]], FeedDrive], settings: FloatArray, command: Record
) -> list[Record]:
    r"""Return, for each setting, the derivatives of the columns that `FeedDrive.respond` returns.

    .. math::
        \frac{\partial w_0}{\partial \theta_j} = \frac{\operatorname{Im}\, w_0(\theta + i \epsilon e_j)}{\epsilon},
        \quad \epsilon = 10^{-200}, \qquad
        \frac{\partial w_{k+1}}{\partial \theta_j} = \frac{\partial \Phi}{\partial w}(w_k)\,
        \frac{\partial w_k}{\partial \theta_j}

    w are the rows of the axis' block, values of the plant and states alike. What it begins with follows from the
    settings by sums, products, quotients and exponentials, and is differentiated by a complex step, which subtracts
    nothing; the stepper :math:`\Phi` in forward mode (`tangents`). Both are exact to rounding. At limits and reversals
    the derivative is that of the branch that is taken; an encoder that counts is taken for one that does not.

    Parameters
    ----------
    drive_at : callable
        The drive at settings (n,), real or complex; kinds and number of its parts stay.
    settings : (n,) array
    command : Record
        As of `FeedDrive.respond`.

    Returns
    -------
    list of n Records
        Units are those of the columns for one of the setting.

    Raises
    ------
    SpecError
        If the loop is unstable at these settings; whether the drive leaves its limits says `FeedDrive.respond`.
    PluginError
        If the kernel of an effect has no rule of differentiation.

    References
    ----------
    Squire, Trapp, Using complex variables to estimate derivatives of real functions, SIAM Review 40 (1998), 110-112;
    Griewank, Walther, Evaluating Derivatives, 2nd ed. 2008, section 3.1.
    """
    axis = nominal_axis(drive_at(settings), command)
    directions = np.zeros((axis.initial.shape[1], len(settings)))
    for rows, unit in zip(directions.T, np.eye(len(settings)), strict=True):
        drive = drive_at(settings + 1j * STEP * unit)
        rows[MECHANICS_ROWS] = np.imag(drive.mechanics().rows(axis.timing.substep_s))
        for name, value in drive.controller.rows().items():
            rows[ROW[name]] = np.imag(value)
        rows[ROW["LOGGED_PER_N"]] = np.imag(1.0 / drive.motor.force_per_unit)
        for slot, effect in zip(axis.slots(), drive.effects, strict=True):
            values = [getattr(effect, item.name) for item in effect.parameters()]
            rows[slot.parameter(0) : slot.parameter(len(values))] = np.imag(values)
    moved = tangents(axis, directions / STEP)
    return [
        Record({"time_s": command["time_s"], **dict(zip(axis.columns, columns.T, strict=True))}, {}, command.source)
        for columns in np.moveaxis(moved, 2, 0)
    ]
