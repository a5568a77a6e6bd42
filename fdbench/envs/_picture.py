"""The picture of an environment, drawn into an array: drive on its rail or path, and strip charts."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fdbench.simulate.system import FloatArray
from fdbench.wording import quantity, si_text

Image = NDArray[np.uint8]
Colour = tuple[int, int, int]

WINDOW_S = 2.0
HEIGHT, WIDTH, MARGIN = 360, 640, 16
PAPER, LINE, SOFT, INK = (250, 250, 252), (205, 209, 217), (110, 118, 132), (52, 58, 70)
BLUE, RED, GREEN, AMBER = (44, 97, 176), (196, 57, 50), (33, 130, 92), (199, 121, 18)

# Five by nine dots, two rows of them below the base line: one digit of base 32 for each row of a character.
CHARACTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyzµ0123456789.-+/_^%:²³"
ROWS, COLUMNS = 9, 5
DOTS = (
    "ehhvhhh00uhhuhhu00ehggghe00uhhhhhu00vgguggv00vgguggg00ehgnhhe00hhhvhhh00e44444e0072222ic00hikokih00ggggggv00"
    "hrllhhh00hppljjh00ehhhhhe00uhhuggg00ehhhlid00uhhukih00ehge1he00v44444400hhhhhhe00hhhhaa400hhhllrh00hha4ahh00"
    "hha444400v1248gv0000e1fhf00gguhhhu0000eggge0011fhhhf0000ehvge0068u88880000fhhhf1egguhhhh0040c444e002062222ic"
    "ggikoki00c44444e0000qllll0000uhhhh0000ehhhe0000uhhhugg00fhhhf1100mpggg0000fge1u0088u88960000hhhhf0000hhha400"
    "00hllla0000ha4ah0000hhhhf1e00v248v0000hhhjtggehjlphe004c4444e00eh168gv00eh161he0026aiv2200vgu11he00egguhhe00"
    "v12448800ehhehhe00ehhf11e0000000cc00000v00000044v4400011248gg00000000v004ah000000pp248jj000cc0cc000s4sgs0000"
    "s4s4s0000"
)
GLYPHS = {character: DOTS[ROWS * n : ROWS * (n + 1)] for n, character in enumerate(CHARACTERS)}
DOT = 2  # pixels
ABOVE = 20  # pixels from the upper edge of a label to the chart below it


@dataclass(frozen=True)
class Trace:
    """Values of one column over the last seconds, newest last."""

    name: str
    values: FloatArray
    colour: Colour

    @property
    def largest(self) -> float:
        """Largest magnitude, which is the scale of its chart."""
        finite = self.values[np.isfinite(self.values)]
        return float(np.abs(finite).max()) if finite.size else 0.0

    def label(self, value: float) -> str:
        """Return name and value, the latter with unit and prefix."""
        text, unit = quantity(self.name)
        return f"{text} {si_text(value, unit)}"

    @property
    def scale(self) -> str:
        """Return the largest magnitude with unit and prefix."""
        return si_text(self.largest, quantity(self.name)[1])


def write(image: Image, text: str, x: int, y: int, colour: Colour = INK) -> None:
    """Write letters, digits and signs with their upper left corner at (x, y)."""
    for index, character in enumerate(text):
        rows = [[int(bit) for bit in f"{int(digit, 32):05b}"] for digit in GLYPHS.get(character, "0" * ROWS)]
        dots = np.kron(np.array(rows, dtype=bool), np.ones((DOT, DOT), dtype=bool))
        left = x + DOT * (COLUMNS + 1) * index
        target = image[y : y + DOT * ROWS, left : left + DOT * COLUMNS]
        target[dots[: target.shape[0], : target.shape[1]]] = colour


def legend(image: Image, top: int) -> None:
    """Write what the colours of rail and path stand for."""
    left = MARGIN
    for colour, text in ((BLUE, "position"), (RED, "reference")):
        image[top + 5 : top + 9, left : left + 16] = colour
        write(image, text, left + 24, top)
        left += 24 + DOT * (COLUMNS + 1) * (len(text) + 2)


def plot(image: Image, trace: Trace, top: int, height: int, n_samples: int, left: int = MARGIN) -> None:
    """Draw a strip chart, with zero in the middle, whose right end is now and whose width holds ``n_samples``."""
    panel = image[top : top + height, left : WIDTH - MARGIN]
    panel[:] = 255
    panel[height // 2] = LINE
    n, width = len(trace.values), panel.shape[1]
    sample = n - n_samples + np.arange(width) * (n_samples - 1) // (width - 1)
    scaled = np.nan_to_num(trace.values) / (trace.largest or 1.0)
    y = np.rint((1.0 - scaled[np.maximum(sample, 0)]) * 0.5 * (height - 1)).astype(int)
    before = np.concatenate((y[:1], y[:-1]))
    rows = np.arange(height)[:, None]
    drawn = (rows >= np.minimum(y, before)) & (rows <= np.maximum(y, before)) & (sample >= 0)
    panel[drawn] = trace.colour
    frame(panel)
    write(image, trace.label(scaled[-1] * trace.largest), left, top - ABOVE)
    write(image, trace.scale, left + 4, top + 4, SOFT)


def frame(panel: Image) -> None:
    """Draw a line around a panel."""
    panel[[0, -1]] = LINE
    panel[:, [0, -1]] = LINE


def place_on_rail(image: Image, position: float, reference: float, span: tuple[float, float]) -> None:
    """Draw rail and table, and a marker where the reference is; ``span`` is what the rail shows."""
    low, high = span

    def pixel(value: float) -> int:
        share = (value - low) / (high - low) if np.isfinite(value) else 0.5
        return round(MARGIN + 40 + min(max(share, 0.0), 1.0) * (WIDTH - 2 * MARGIN - 80))

    image[86:92, MARGIN : WIDTH - MARGIN] = LINE
    at, wanted = pixel(position), pixel(reference)
    image[62:86, at - 32 : at + 32] = BLUE
    image[54:62, at - 10 : at + 10] = BLUE
    for row in range(10):
        image[94 + row, wanted - row // 2 : wanted + row // 2 + 1] = RED


def place_on_path(panel: Image, path: FloatArray, reference: FloatArray, sample: int) -> None:
    """Draw the reference (n_samples, 2), the ``path`` (n, 2) of the last seconds, and table and marker at its end.

    Both axes have one scale; the panel is square.
    """
    side, room = len(panel), 10
    middle = 0.5 * (reference.min(axis=0) + reference.max(axis=0))
    per_metre = (side - 2 * room) / (float(np.ptp(reference, axis=0).max()) or 1.0)

    def mark(points: FloatArray, radius: int, colour: Colour) -> None:
        xy = 0.5 * side + (np.nan_to_num(points) - middle) * per_metre
        column, row = np.clip(np.rint(xy), radius, side - 1 - radius).astype(int).T
        for step in range(-radius, radius + 1):
            for across in range(-radius, radius + 1):
                panel[side - 1 - row + step, column + across] = colour

    def joined(points: FloatArray) -> FloatArray:
        longest = float(np.abs(np.diff(points, axis=0)).max(initial=0.0)) * per_metre
        at = np.linspace(0.0, len(points) - 1.0, 1 + (len(points) - 1) * min(max(1, math.ceil(longest)), side))
        return np.column_stack([np.interp(at, np.arange(len(points)), axis) for axis in points.T])

    panel[:] = 255
    frame(panel)
    mark(joined(reference), 0, RED)
    mark(joined(np.nan_to_num(path)), 1, BLUE)
    mark(path[-1:], 5, BLUE)
    mark(reference[sample : sample + 1], 2, RED)


def draw_plane(title: str, place: tuple[FloatArray, FloatArray, int], traces: Sequence[Trace], n_samples: int) -> Image:
    """Return the picture of two axes as a (360, 640, 3) array.

    Parameters
    ----------
    title : str
    place : path (n, 2) of the last seconds, whole reference (n_samples, 2), and the present sample
    traces : sequence of Trace
        Two strip charts.
    n_samples : int
        Samples over the width of a chart.
    """
    image = np.empty((HEIGHT, WIDTH, 3), dtype=np.uint8)
    image[:] = PAPER
    write(image, title, MARGIN, 8)
    legend(image, 30)
    side = 224
    place_on_path(image[74 : 74 + side, MARGIN : MARGIN + side], *place)
    for index, trace in enumerate(traces):
        plot(image, trace, 74 + 130 * index, 94, n_samples, 2 * MARGIN + side)
    return image


def draw(title: str, place: tuple[float, float, tuple[float, float]], traces: Sequence[Trace], n_samples: int) -> Image:
    """Return the picture as a (360, 640, 3) array.

    Parameters
    ----------
    title : str
    place : position, reference and the (low, high) of the rail
    traces : sequence of Trace
        The command at the motor, drawn as a bar, and two strip charts.
    n_samples : int
        Samples over the width of a chart.
    """
    image = np.empty((HEIGHT, WIDTH, 3), dtype=np.uint8)
    image[:] = PAPER
    write(image, title, MARGIN, 8)
    legend(image, 30)
    place_on_rail(image, *place)
    bar, *charts = traces
    middle, half = WIDTH // 2, (WIDTH - 2 * MARGIN) // 2
    now = float(np.nan_to_num(bar.values[-1]))
    end = middle + round(now / (bar.largest or 1.0) * half)
    image[128:140, MARGIN : WIDTH - MARGIN] = 255
    image[128:140, min(middle, end) : max(middle, end) + 1] = bar.colour
    image[124:144, middle] = INK
    write(image, f"{bar.label(now)} of {bar.scale}", MARGIN, 128 - ABOVE)
    for index, trace in enumerate(charts):
        plot(image, trace, 166 + 104 * index, 80, n_samples)
    return image
