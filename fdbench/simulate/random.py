"""Named random streams: one generator for each seed and name, so that a new noise source never shifts another."""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
        self._generators: list[list[np.random.Generator]] = [[] for _ in range(n_lanes)]
        n_blocks = -(-n_lanes // width)
        self.normal = np.zeros((n_blocks, CHUNK, n_normal, width))
        self.uniform = np.zeros((n_blocks, CHUNK, n_uniform, width))
        self.position = CHUNK

    def start(self, seeds: Sequence[int], lanes: NDArray[np.intp]) -> None:
        """Begin the streams of some lanes within the present chunk; of all of them: a new chunk."""
        if len(lanes) == len(self._generators):
            self.position = CHUNK
        n = CHUNK - self.position
        for lane, seed in zip(lanes.tolist(), seeds, strict=True):
            block, place = divmod(lane, self._width)
            self._generators[lane] = [stream(seed, source.stream) for source in self._sources]
            for generator, source in zip(self._generators[lane], self._sources, strict=True):
                drawn = generator.standard_normal(n) if source.normal else generator.random(n)
                self._of(source)[block, self.position :, source.column, place] = drawn

    def refill(self) -> None:
        """Draw a chunk for all lanes, one block at a time: a transposed copy is faster than columns far apart."""
        drawn = np.zeros((self._width, CHUNK))
        for number, source in enumerate(self._sources):
            target = self._of(source)
            for block in range(len(target)):
                for row, generators in zip(drawn, self._generators[block * self._width :], strict=False):
                    if source.normal:
                        generators[number].standard_normal(out=row)
                    else:
                        generators[number].random(out=row)
                target[block, :, source.column, :] = drawn.T
        self.position = 0

    def _of(self, source: RandomSource) -> NDArray[np.float64]:
        return self.normal if source.normal else self.uniform
