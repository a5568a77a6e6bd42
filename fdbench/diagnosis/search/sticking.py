"""A known friction that sticks: at rest it holds the axis, where a friction of the speed alone lets it creep."""

from collections.abc import Callable, Sequence

from fdbench.diagnosis.evidence.prepare import Aligned
from fdbench.diagnosis.model.friction_parameters import TransitionVelocity
from fdbench.diagnosis.model.nominal_parameters import nominal_parameters
from fdbench.diagnosis.records.runs import POSITION
from fdbench.diagnosis.search.calibrated import Calibrated
from fdbench.diagnosis.settings import SEARCH
from fdbench.effects import Effect
from fdbench.plants.feed_drive import Following


def that_sticks(best: Calibrated, beside: Callable[[Sequence[Effect]], Aligned]) -> Calibrated:
    """Return the re-calibrated model, or one whose known friction sticks where that brings more than a cause costs.

    A friction that turns its sign by far faster than on paper seems to stick. Where bristles in its place bend over no
    more than readings show, they say nothing but that, and are as strong as on paper at any speed; where they bend over
    more, or are stronger at rest, they are a cause to be found. A virtual loop has to bend what sticks to follow a
    motion, by more than an encoder shows: along one, such bristles are as likely as a friction that turns its sign
    steeply, and have to bring no more than that.

    Parameters
    ----------
    best : Calibrated
    beside : callable
        Returns the records prepared for a model with other known effects.
    """
    nominal, known = best.ready.nominal, best.ready.nominal.drive.effects
    noise, follows = best.ready.split.noise_models[POSITION], isinstance(nominal.drive.controller, Following)
    by_reading_m = min(SEARCH.unseen_bend * noise.total, SEARCH.unseen_reading * noise.at_high_frequencies)
    unseen_m = SEARCH.unseen_following * noise.total if follows else by_reading_m
    shifts = zip(nominal_parameters(nominal), best.hypothesis.shifts, strict=True)
    steep = [item.index for item, shift in shifts if isinstance(item, TransitionVelocity) and shift < -SEARCH.steep]
    forms = [
        (index, form)
        for index in steep
        for kind in nominal.library
        if (form := kind.that_sticks(known[index], noise.total))
    ]
    if not forms or best.misfit < SEARCH.noise_alone:
        return best
    index, form = forms[0]
    found = best.refinement.refine(best.hypothesis.with_effect(form, index)).effects[-1]
    if found.bend_m > unseen_m:
        return best
    sizes = (type(form).amplitude, *type(form).further_amplitudes)
    found = found.changed(**{size: getattr(form, size) for size in sizes})
    tried = Calibrated.of(
        beside([*known[:index], found, *known[index + 1 :]]).assuming(
            f"The known {known[index].name} seems to stick at rest: as {found.name} with bristles that bend over no "
            "more than the readings show it fits better, whatever its size. Write it so in the model."
        )
    )
    return tried if tried.cost < best.cost - (0.0 if follows else best.hypothesis.cost_of_a_cause) else best
