"""Named random streams: one generator for each seed and name, so that a new noise source never shifts another."""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fdbench.simulate import pcg64
from fdbench.simulate.memory import aligned_zeros

CHUNK = 256  # samples of random numbers drawn at once


def stream(seed: int, name: str) -> np.random.Generator:
    """Return the generator of the stream ``name`` for ``seed``.

    >>> float(stream(1, "encoder").random()) == float(stream(1, "encoder").random())
    True
    """
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(zlib.crc32(name.encode()),)))


@dataclass(frozen=True, kw_only=True)
class RandomSource:
    """One random number a sample: the name of its stream, its column, and whether it is normal or uniform."""

    stream: str
    column: int
    normal: bool = True


class RandomNumbers:
    """Standard normal and uniform numbers of lanes, drawn `CHUNK` samples at once, in the layout of the steppers.

    However the samples are split, and whichever lane starts again in between, a lane gets the same numbers.

    Parameters
    ----------
    sources : sequence of RandomSource
    n_lanes, width : int
        Lanes, and how many of them lie side by side.
    n_normal, n_uniform : int
        Columns; those without a source hold zeros.

    Attributes
    ----------
    normal, uniform : (n_blocks, CHUNK, n_columns, width) arrays
    position : int
        Sample of the chunk that comes next; CHUNK where a new one has to be drawn.
    """

    def __init__(
        self, sources: Sequence[RandomSource], n_lanes: int, width: int, n_normal: int, n_uniform: int = 0
    ) -> None:
        self._sources = tuple(sources)
        self._width = width
        n_blocks = -(-n_lanes // width)
        self._states = np.zeros((len(self._sources), 4, n_lanes), dtype=np.uint64)
        self.normal = aligned_zeros(n_blocks, CHUNK, n_normal, width)
        self.uniform = aligned_zeros(n_blocks, CHUNK, n_uniform, width)
        self.position = CHUNK

    def start(self, seeds: Sequence[int], lanes: NDArray[np.intp]) -> None:
        """Begin the streams of some lanes within the present chunk; of all of them: a new chunk."""
        if len(lanes) == self._states.shape[2]:
            self.position = CHUNK
        for lane, seed in zip(lanes.tolist(), seeds, strict=True):
            for states, source in zip(self._states, self._sources, strict=True):
                states[:, lane] = pcg64.words(stream(seed, source.stream))
                if self.position < CHUNK:
                    self._fill(states, source, self.position, (lane, lane + 1))

    def refill(self) -> None:
        """Draw a chunk for all lanes."""
        n_lanes = self._states.shape[2]
        for states, source in zip(self._states, self._sources, strict=True):
            for lane in range(0, n_lanes, self._width):
                self._fill(states, source, 0, (lane, min(lane + self._width, n_lanes)))
        self.position = 0

    def _fill(self, states: NDArray[np.uint64], source: RandomSource, first: int, lanes: tuple[int, int]) -> None:
        if source.normal:
            pcg64.fill_normal(states, self.normal, first, source.column, lanes, pcg64.ziggurat())
        else:
            pcg64.fill_uniform(states, self.uniform, first, source.column, lanes)
