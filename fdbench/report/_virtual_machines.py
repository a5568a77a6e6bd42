"""What a calibration showed, in words: how often virtual machines like the measured one were diagnosed rightly."""

from collections.abc import Iterator

from fdbench.diagnosis.answer.answer import Answer
from fdbench.diagnosis.answer.virtual_machines import VirtualMachines
from fdbench.wording import percent

UNLIKE = 0.1  # p-value up to which the measured machine is not like the virtual ones: wrongly in one of ten


def virtual_machines(answer: Answer) -> Iterator[str]:
    """Yield how virtual machines like the measured one were diagnosed."""
    found = answer.virtual_machines
    if found is None:
        return
    if found.with_cause:
        low, high = found.rightly_ci95
        yield (
            f"of {found.with_cause} with a cause that the library has, the cause named first is there in "
            f"{found.named_rightly}: {percent(found.named_rightly / found.with_cause)} (95 %: {percent(low)} to "
            f"{percent(high)})"
        )
    if found.without_cause:
        yield f"of {found.without_cause} with nothing, a cause was named in {found.named_falsely}"
    yield _likeness(found)


def unlike(answer: Answer) -> Iterator[str]:
    """Yield that the measured machine is unlike the virtual ones, or cannot be compared with them, as a doubt."""
    found = answer.virtual_machines
    if found is not None and (found.likeness <= UNLIKE or not _enough(found)):
        yield f"Calibration: {_likeness(found)}."


def _enough(found: VirtualMachines) -> bool:
    return 1.0 / (found.compared + 1) <= UNLIKE


def _likeness(found: VirtualMachines) -> str:
    if not _enough(found):
        return (
            f"{found.compared} virtual machines without a cause that the library lacks are too few to say whether the "
            "measured one is like them; 20 in all are mostly enough"
        )
    fewer = f"in {round(found.likeness * (found.compared + 1)) - 1} of {found.compared}"
    if found.likeness <= UNLIKE:
        return (
            f"not exchangeable (p = {found.likeness:.2f}): more is left of the measured gap beside all effects than of "
            f"nearly all virtual ones; as much is left {fewer} that have no cause beyond the library. The measured "
            "machine has more than its model and the library's effects, so how often the virtual ones were diagnosed "
            "rightly need not hold for it"
        )
    return (
        f"exchangeable as far as one can tell (p = {found.likeness:.2f}): as much as of the measured gap is left "
        f"beside all effects {fewer} that have no cause beyond the library"
    )
