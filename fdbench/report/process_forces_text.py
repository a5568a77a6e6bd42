"""The forces of a process in words: what acts in records of another condition, or does not repeat."""

import math
from collections.abc import Iterator

from fdbench.diagnosis.answer.answer import Answer
from fdbench.diagnosis.answer.process_force import ProcessForce
from fdbench.diagnosis.settings import JUDGE
from fdbench.wording import si_text


def forces(answer: Answer) -> list[ProcessForce]:
    """Return one force for each record, not that beside the nominal model where there is a better one."""
    apart = {force.record for force in answer.process_forces if force.beside != "nominal"}
    return [force for force in answer.process_forces if force.beside != "nominal" or force.record not in apart]


def process_forces(answer: Answer) -> Iterator[str]:
    """Yield what acts in each record of another condition: how large, when, at which frequency, how sure."""
    for force in forces(answer):
        condition = f" ({force.condition})" if force.condition else ""
        beside = {
            "repeats": "beside the records of the same command",
            "model": "beside the final model, whose own error is in it",
            "nominal": "beside the nominal model, whose own error is in it",
        }[force.beside]
        left_out = "" if force.beside == "nominal" else " The record is left out of all the rest."
        within = JUDGE.sure_of_force * force.standard_deviation_N
        if force.rms_N <= within:
            yield (f"{force.record}{condition}: no more than {si_text(within, 'N')} acts {beside}.{left_out}")
            continue
        first, last = force.range_s
        line = ""
        if force.frequency_Hz is not None and force.amplitude_N is not None:
            sine = (
                f"{si_text(force.amplitude_N, 'N')} amplitude ({si_text(force.amplitude_N / math.sqrt(2.0), 'N')} rms)"
            )
            line = f", its strongest line a sine of {sine} at {force.frequency_Hz:.3g} Hz"
        yield (
            f"{force.record}{condition}: a force acts that the model and the other records lack, {beside}: "
            f"from {first:.3g} to {last:.3g} s {si_text(force.rms_N, 'N')} rms, {si_text(force.mean_N, 'N')} on "
            f"average, {si_text(force.largest_N, 'N')} at most{line}; each value is known to "
            f"{si_text(1.96 * force.standard_deviation_N, 'N')} (95 %).{left_out}"
        )
