"""Response columns: where the responses of a run are that stand beside its gap."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fdbench.diagnosis.model.hypothesis import Hypothesis
from fdbench.diagnosis.model.kept_responses import KeptResponses, Pair, Stretch


@dataclass(frozen=True, kw_only=True, eq=False)
class ResponseColumns:
    """Where the responses of a run are: some are kept, the others are in readings. Column 0 is the gap.

    Attributes
    ----------
    n_columns : int
        The gap and all responses.
    asked : list of Hypothesis
        What is read: the base, what the responses are of that are not kept, and what they are counted from.
    new : (n_new,) array of int
        Columns of those responses, in this order.
    counted_from : (n_new,) array of int
        Row of the readings from which each is counted.
    pairs : list of Pair
        Of the first responses: they are kept, or to be.
    kept : KeptResponses
        Of the run.
    stretches : list of Stretch
        Where those lie that are kept.
    """

    n_columns: int
    asked: list[Hypothesis]
    new: NDArray[np.intp]
    counted_from: NDArray[np.intp]
    pairs: list[Pair]
    kept: KeptResponses
    stretches: list[Stretch]

    @classmethod
    def of(
        cls, base: Hypothesis, responses: Sequence[tuple[Hypothesis, Hypothesis]], kept: KeptResponses, n_kept: int
    ) -> "ResponseColumns":
        """Return those of hypotheses and what each is counted from; of the first ones responses are to be kept."""
        pairs = [(own.key, about.key) for own, about in responses[:n_kept]]
        new = [place for place in range(len(responses)) if place >= n_kept or pairs[place] not in kept]
        about = [responses[place][1] for place in new]
        origins = list({id(item): item for item in about if item is not base}.values())
        row_of = {id(base): 0} | {id(item): row for row, item in enumerate(origins, 1 + len(new))}
        return cls(
            n_columns=1 + len(responses),
            asked=[base, *(responses[place][0] for place in new), *origins],
            new=1 + np.array(new, dtype=np.intp),
            counted_from=np.array([row_of[id(item)] for item in about], dtype=np.intp),
            pairs=pairs,
            kept=kept,
            stretches=kept.stretches(pairs),
        )

    @property
    def to_keep(self) -> list[Pair]:
        """Of the new responses, those that are to be kept: they come first."""
        return [self.pairs[column - 1] for column in self.new if column <= len(self.pairs)]
