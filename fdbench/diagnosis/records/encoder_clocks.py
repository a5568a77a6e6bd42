"""Clocks of two encoders: by how much later than the motor's the table's position is read."""

from collections.abc import Mapping, Sequence

import numpy as np

from fdbench.diagnosis.records.runs import POSITION, RecordedRun, left_between_encoders
from fdbench.diagnosis.settings import PLAUSIBLE
from fdbench.record import FloatArray
from fdbench.wording import si_text


def encoder_clock_warnings(runs: Sequence[RecordedRun], simulated: Sequence[Mapping[str, FloatArray]]) -> list[str]:
    r"""Return what to say of two positions that are not read at one time, as far as a model tells it.

    What the model leaves of their difference d is fitted by a zero, play or friction, masses and the delay
    :math:`\tau`, with the speed v of the model,

    .. math:: d = c_0 + c_1 \operatorname{sgn} v + c_2 \dot v + \tau v

    which is said where the delay alone takes most of what is left beside the others.

    Parameters
    ----------
    runs : sequence of RecordedRun
    simulated : sequence of mappings
        Channels of each run as the re-calibrated model has them.
    """
    left = left_between_encoders(runs, simulated)
    if left is None:
        return []
    period_s = runs[0].period_s
    speeds = [np.gradient(own[POSITION], period_s) for own in simulated]
    speed, rate = np.concatenate(speeds), np.concatenate([np.gradient(own, period_s) for own in speeds])
    others = np.stack((np.ones_like(speed), np.sign(speed), rate), axis=1)
    if not (np.isfinite(left).all() and np.isfinite(others).all()) or float(np.ptp(speed)) == 0.0:
        return []
    both = np.stack((left, speed), axis=1)
    alone, ahead = (both - others @ np.linalg.lstsq(others, both, rcond=None)[0]).T
    told = max(float(ahead @ ahead), 1e-300)
    late_s = float(alone @ ahead) / told
    removed = late_s**2 * told / max(float(alone @ alone), 1e-300)
    if removed < PLAUSIBLE.delayed or abs(late_s) < PLAUSIBLE.encoders_apart * period_s:
        return []
    return [late_encoder_text(late_s, "what the model leaves between them grows with the speed")]


def late_encoder_text(late_s: float, why: str) -> str:
    """Return what to say of a table's position that is read so much later than the motor's, and of what becomes of it.

    Before it, where that is below 0.
    """
    return (
        f"table_position_m seems to be read {si_text(abs(late_s), 's')} {'after' if late_s > 0.0 else 'before'} "
        f"motor_position_m: {why}. If each has a clock of its own, `late_s = {late_s:.3g}` for the table's column in "
        "the mapping puts that right, or `table_read_late_s` in [plant]. If they have one, nothing here names what "
        "makes the table lag by a time."
    )
