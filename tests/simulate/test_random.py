"""Random numbers of lanes: those of NumPy's generators, to the bit, however lanes start."""

import numpy as np

from fdbench.simulate.pcg64 import fill_normal, words, ziggurat
from fdbench.simulate.random import CHUNK, RandomNumbers, RandomSource, stream

SOURCES = (
    RandomSource(stream="reading", column=1),
    RandomSource(stream="jitter", column=0, normal=False),
    RandomSource(stream="equation", column=0),
)
N_LANES, WIDTH = 70, 64


def test_numbers_of_lanes_are_those_of_numpy() -> None:
    # 40 chunks: a tail is drawn about 370 times, and every layer's rim.
    numbers = RandomNumbers(SOURCES, N_LANES, WIDTH, n_normal=2, n_uniform=1)
    numbers.start(range(N_LANES), np.arange(N_LANES))
    generators = [[stream(lane, source.stream) for source in SOURCES] for lane in range(N_LANES)]
    for _ in range(40):
        numbers.refill()
        for lane, own in enumerate(generators):
            for source, generator in zip(SOURCES, own, strict=True):
                expected = generator.standard_normal(CHUNK) if source.normal else generator.random(CHUNK)
                table = numbers.normal if source.normal else numbers.uniform
                found = table[lane // WIDTH, :, source.column, lane % WIDTH]
                np.testing.assert_array_equal(found, expected)


def test_a_lane_that_starts_within_a_chunk_leaves_others_alone() -> None:
    numbers = RandomNumbers(SOURCES, N_LANES, WIDTH, n_normal=2, n_uniform=1)
    numbers.start(range(N_LANES), np.arange(N_LANES))
    numbers.refill()
    before, numbers.position = numbers.normal.copy(), 100
    numbers.start([7], np.array([66]))
    generator = stream(7, "reading")
    np.testing.assert_array_equal(numbers.normal[1, 100:, 1, 2], generator.standard_normal(CHUNK - 100))
    np.testing.assert_array_equal(numbers.normal[1, :100, 1, 2], before[1, :100, 1, 2])
    np.testing.assert_array_equal(numbers.normal[:, :, :, 3:], before[:, :, :, 3:])
    numbers.refill()
    np.testing.assert_array_equal(numbers.normal[1, :, 1, 2], generator.standard_normal(CHUNK))


def test_many_numbers_of_one_stream_are_those_of_numpy() -> None:
    generator, found = np.random.default_rng(5), np.empty((1, 2_000_000, 1, 1))
    states = np.array([words(generator)], dtype=np.uint64).T.copy()
    fill_normal(states, found, 0, 0, (0, 1), ziggurat())
    np.testing.assert_array_equal(found.ravel(), generator.standard_normal(found.size))
    assert words(generator) == states.ravel().tolist()


def test_layers_have_one_area() -> None:
    widths, certain, heights = ziggurat()
    edges = widths * 2.0**52
    np.testing.assert_allclose(heights[1:], np.exp(-0.5 * edges[1:] ** 2), rtol=1e-15)
    np.testing.assert_allclose(edges[2:] * (heights[1:-1] - heights[2:]), edges[0] * heights[-1], rtol=2e-13)
    assert certain[1] == 0.0
    np.testing.assert_allclose(certain[2:] * widths[2:], edges[1:-1], rtol=1e-15)
