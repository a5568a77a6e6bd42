"""Responses that serve several fits: what hypotheses read along a run less what others read, and their products."""

import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fdbench.diagnosis.model.hypothesis import Key
from fdbench.diagnosis.records.runs import RecordedRun
from fdbench.record import FloatArray

Pair = tuple[Key, Key]  # a hypothesis, and what its response is counted from
Block = Mapping[str, FloatArray]  # responses in each channel, (n_responses, n_samples)


@dataclass(frozen=True, kw_only=True, eq=False)
class Stretch:
    """Responses one after the other, as they lie in a block: which of those asked for, and which rows."""

    asked: slice
    rows: slice
    block: Block


class KeptResponses:
    """Responses along one run, in the units of its channels, and the products of some of them over its segments."""

    def __init__(self) -> None:
        self._at: dict[Pair, tuple[Block, int]] = {}
        self._of_products: dict[Pair, int] = {}
        self._products: Mapping[str, FloatArray] = {}
        self._forgotten: list[dict[str, FloatArray]] = []

    def room(self, run: RecordedRun, n_responses: int) -> dict[str, FloatArray]:
        """Return room for responses, (n_responses, n_samples) of each channel: where forgotten ones were, if it is.

        Pages of new arrays cost as much as what is simulated into them.
        """
        rows = [len(next(iter(own.values()))) for own in self._forgotten]
        fits = [place for place, n in enumerate(rows) if n_responses <= n <= 2 * n_responses]
        if fits:
            whole = self._forgotten.pop(min(fits, key=rows.__getitem__))
        else:
            whole = {name: np.empty((n_responses, run.n_samples)) for name in run.channels}
        return {name: own[:n_responses] for name, own in whole.items()}

    def __contains__(self, pair: Pair) -> bool:
        return pair in self._at

    def keep(self, pairs: Sequence[Pair], block: Block) -> None:
        """Keep responses that are the rows of a block."""
        self._at |= {pair: (block, row) for row, pair in enumerate(pairs)}

    def stretches(self, pairs: Sequence[Pair]) -> list[Stretch]:
        """Return where those of some pairs lie that are kept."""
        found: list[Stretch] = []
        for place, pair in enumerate(pairs):
            if pair not in self._at:
                continue
            block, row = self._at[pair]
            if found and found[-1].block is block and (found[-1].asked.stop, found[-1].rows.stop) == (place, row):
                last = found.pop()
                found.append(
                    Stretch(asked=slice(last.asked.start, place + 1), rows=slice(last.rows.start, row + 1), block=block)
                )
            else:
                found.append(Stretch(asked=slice(place, place + 1), rows=slice(row, row + 1), block=block))
        return found

    def keep_products(self, pairs: Sequence[Pair], products: Mapping[str, FloatArray]) -> None:
        """Keep in each channel new products, (n_segments, n_pairs, n_pairs), in place of those before."""
        if any(pair not in self._of_products for pair in pairs):
            self._of_products = {pair: place for place, pair in enumerate(pairs)}
            self._products = {name: values.copy() for name, values in products.items()}

    def products(self, pairs: Sequence[Pair]) -> dict[str, FloatArray]:
        """Return in each channel the products of the first responses, as far as they are at hand."""
        known = [self._of_products[pair] for pair in itertools.takewhile(self._of_products.__contains__, pairs)]
        if known == [*range(len(known))]:
            return {name: own[:, : len(known), : len(known)] for name, own in self._products.items()}
        return {name: own[:, known][:, :, known] for name, own in self._products.items()}

    def forget(self, keys: Collection[Key]) -> None:
        """Keep responses of hypotheses no longer."""
        before = {id(block): block for block, _ in self._at.values()}
        self._at = {pair: at for pair, at in self._at.items() if pair[0] not in keys}
        for place in before.keys() - {id(block) for block, _ in self._at.values()}:
            self._forgotten.append({name: own if own.base is None else own.base for name, own in before[place].items()})
        self._of_products = {pair: place for pair, place in self._of_products.items() if pair[0] not in keys}
