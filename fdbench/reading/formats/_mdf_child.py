"""Reads an MDF file by asammdf in a process of its own: ``python -m`` this, with the file and where to write arrays.

Prints name, group and unit of each channel of numbers as JSON, or what is wrong with the file, and then ends with 1.
"""

import json
import logging
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np


def main(file: Path, written: Path) -> int:
    """Write the channels, print what they are, and return the exit code."""
    import asammdf

    logging.getLogger("asammdf").setLevel(logging.CRITICAL + 1)  # what it logs of a damaged file is raised too
    facts: list[tuple[str, int, str]] = []
    arrays: dict[str, Any] = {}
    try:
        with asammdf.MDF(file) as content:
            for signal in content.iter_channels(skip_master=True, copy_master=True):
                if signal.samples.dtype.kind not in "biuf" or signal.samples.ndim != 1 or not len(signal.samples):
                    continue
                arrays[f"{len(facts)}.samples"] = np.asarray(signal.samples)
                arrays[f"{len(facts)}.times"] = np.asarray(signal.timestamps, dtype=np.float64)
                facts.append((signal.name, int(signal.group_index), signal.unit or ""))
    except Exception as error:  # noqa: BLE001 asammdf has no common base for what damaged files raise
        sys.stdout.write(" ".join(str(error).split()) or type(error).__name__)
        return 1
    np.savez(written, **arrays)
    sys.stdout.write(json.dumps(facts))
    return 0


if __name__ == "__main__":
    code = main(Path(sys.argv[1]), Path(sys.argv[2]))
    sys.stdout.flush()
    os._exit(code)  # a reader of a damaged file, half made, fails once more when it is discarded
