"""What a calibration showed, in words: how often the cause was named rightly on virtual machines like the measured one."""

from collections.abc import Iterator

from fdbench.diagnosis.answer import Answer, VirtualMachines
from fdbench.wording import percent

UNLIKE = 0.05  # probability below which the measured machine is not one of the virtual ones


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
    return 1.0 / (found.cases + 1) <= UNLIKE


def _likeness(found: VirtualMachines) -> str:
    if not _enough(found):
        return (
            f"{found.cases} virtual machines are too few to say whether the measured one is like them; take 19 or more"
        )
    if found.likeness <= UNLIKE:
        return (
            f"not exchangeable: the records are unlike those of the virtual machines (p = {found.likeness:.3f}), most of "
            f"all by {found.furthest}. How often these were diagnosed rightly, and the probabilities learned from them, "
            "need not hold for the measured machine: it has more than its model and one of the library's effects"
        )
    return f"the records are like those of the virtual machines (p = {found.likeness:.2f}), as far as their gaps go"
