"""A measured frequency response: of a table of frequencies, or estimated from a record with a broadband motion."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fdbench.errors import RecordError, did_you_mean
from fdbench.reading import read_record
from fdbench.reading.formats import EVERYTHING, open_text
from fdbench.reading.formats.csv import Csv
from fdbench.record import FloatArray, Record
from fdbench.report.record import check_sizes

FREQUENCY = "frequency_Hz"
OF_PLANT = ("magnitude_m_per_N", "magnitude_rad_per_Nm")
MAGNITUDES = ("magnitude", "magnitude_dB", *OF_PLANT)
COLUMNS = (FREQUENCY, *MAGNITUDES, "phase_rad", "phase_deg")
LONGEST_HEAD = 4096  # letters
LARGEST = 1e9  # number in a table
SEGMENTS = 8  # of a record, whose spectra are averaged
COHERENT = 0.9  # squared coherence from which on an estimate is drawn
EXCITED = 1e-8  # share of the largest power of the command


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredResponse:
    """Frequencies (n,), magnitudes (n,), and phases in rad (n,) where they are known; whether of the plant alone."""

    name: str
    frequency_Hz: FloatArray
    magnitude: FloatArray
    phase_rad: FloatArray | None
    is_of_plant: bool = False


def read_response(path: Path) -> MeasuredResponse:
    """Return the response in a CSV table of `COLUMNS`, or that of a record: position over commanded position.

    A table with one of `OF_PLANT` is of the plant alone: position over force, or angle over torque.

    Raises
    ------
    RecordError
        If the file is neither, or its record moves at too few frequencies.
    """
    if path.suffix.lower() == ".csv" and path.is_file():
        with open_text(path) as file:
            head = file.readline(LONGEST_HEAD).decode("utf-8", errors="replace")
        if "frequency" in head.lower() and "time_s" not in head:
            return _of_table(path)
    return of_record(read_record(path))


def _of_table(path: Path) -> MeasuredResponse:
    raw = Csv().read(path, EVERYTHING)
    table = {name: column.astype(np.float64) for name, column in raw.columns.items()}
    for name in (*table, *raw.left_out):
        if name not in COLUMNS:
            raise RecordError(f"{path}: unknown column '{name}'.{did_you_mean(name, COLUMNS)}")
    if raw.left_out:
        raise RecordError(
            f"{path}: column {next(iter(raw.left_out))} of a table of numbers holds empty cells, or what is no number."
        )
    for names in ((FREQUENCY,), MAGNITUDES):
        if sum(name in table for name in names) != 1:
            raise RecordError(f"{path}: one column {' or '.join(names)} is needed.")
    if "phase_rad" in table and "phase_deg" in table:
        raise RecordError(f"{path}: phase_rad and phase_deg are one column too many.")
    frequency = table[FREQUENCY]
    largest = max(float(np.abs(column).max()) for column in table.values()) if len(frequency) else np.nan
    if not largest <= LARGEST or not (frequency > 0.0).all() or len(frequency) < 2:
        raise RecordError(
            f"{path}: two or more rows of numbers up to {LARGEST:g} with a positive {FREQUENCY} are needed."
        )
    (kind,) = (name for name in MAGNITUDES if name in table)
    magnitude = 10.0 ** (np.clip(table[kind], -2e3, 2e3) / 20.0) if kind == "magnitude_dB" else table[kind]
    phase = np.radians(table["phase_deg"]) if "phase_deg" in table else None
    phase = table.get("phase_rad", phase)
    return MeasuredResponse(
        name=path.name,
        frequency_Hz=frequency,
        magnitude=magnitude,
        phase_rad=phase,
        is_of_plant=kind in OF_PLANT,
    )


def of_record(record: Record) -> MeasuredResponse:
    r"""Return the estimate :math:`\hat G = S_{ur} / S_{rr}` of position u over commanded position r, by Welch's method.

    Both are differenced, which cancels, as positions have most of their power at the lowest frequencies. Frequencies
    without power, or with a squared coherence below `COHERENT`, are left out. Source: Bendat, Piersol (2010), Random
    Data, eq. (6.37).

    Raises
    ------
    RecordError
        If fewer than 2 frequencies are left, or a position is too large to compute with.
    """
    from scipy.signal import csd, welch

    check_sizes(record, ("reference_position_m", "position_m"))
    rate_Hz = 1.0 / record.sampling_time_s
    command, moved = np.diff(record["reference_position_m"]), np.diff(record["position_m"])
    length = min(max(16, len(command) // SEGMENTS), len(command))
    frequency, cross = csd(command, moved, rate_Hz, nperseg=length)
    of_command, of_moved = (welch(values, rate_Hz, nperseg=length)[1] for values in (command, moved))
    kept = (frequency > 0.0) & (of_command > EXCITED * of_command.max()) & (of_moved > 0.0)
    coherence = np.abs(cross[kept]) ** 2 / (of_command[kept] * of_moved[kept])
    kept[kept] = coherence > COHERENT
    if kept.sum() < 2:
        raise RecordError(
            f"{record.source}: the command moves the axis at fewer than 2 frequencies, with the position following it "
            "(squared coherence above 0.9); a broadband motion such as a schroeder_multisine is needed."
        )
    response = cross[kept] / of_command[kept]
    return MeasuredResponse(
        name=record.source,
        frequency_Hz=frequency[kept],
        magnitude=np.abs(response),
        phase_rad=np.unwrap(np.angle(response)),
    )
