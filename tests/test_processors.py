"""The same on every processor: records to the bit, scores to the digits that are printed."""

import json
import os
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from fdbench.simulate.exponential import exponential

INFORMATION = Path("/proc/cpuinfo")
WIDE = INFORMATION.is_file() and "avx512dq" in INFORMATION.read_text("utf-8")
PROCESSORS = ({"OPENBLAS_CORETYPE": "Prescott", "NUMBA_CPU_NAME": "generic"}, {"OPENBLAS_CORETYPE": "Haswell"})
PROCESSORS += ({"OPENBLAS_CORETYPE": "SkylakeX"},) if WIDE else ()
DRIVES = ["least_squares", "krls_t", "pl_lssvm", "kalman", "slr_nfb", "hybrid_rls"]
RUNS = {
    "LinearMotorAxis-v1": [name for name in DRIVES if name != "pl_lssvm"],
    "ShakerConstant-v2": DRIVES,
    "SensorNetworkLine-v0": ["kalman_weighted", "kalman_parallel", "kalman_consensus"],
    "DriveCurrentClosed-v0": ["kalman"],
    "SlotMilling-v0": ["least_squares", "frequency_least_squares"],
    "ServoStaircase-v1": ["hybrid_rls"],
}
SCORES = """
import hashlib, json, sys
from pathlib import Path
from tempfile import TemporaryDirectory
import pandas
from fdbench.benchmark.run import run
from fdbench.scenario import load_scenario
found = {}
for name, estimators in json.loads(sys.argv[1]).items():
    record, _ = load_scenario(name).observe(0)
    bits = hashlib.sha256(b"".join(values.tobytes() for _, values in record.items())).hexdigest()
    with TemporaryDirectory() as folder:
        run([name], estimators, 1, folder)
        scores = pandas.read_parquet(Path(folder, "scores.parquet"))
    kept = scores[(scores["metric"] != "microseconds_per_sample") & (scores["status"] == "ok")]
    values = {f"{row.estimator} {row.metric}": f"{row.value:.3g}" for row in kept.itertuples()}
    found[name] = [bits, values]
print(json.dumps(found))
"""


@pytest.mark.processors
def test_records_and_scores_are_the_same_everywhere() -> None:
    found = []
    for processor in PROCESSORS:
        command = [sys.executable, "-c", SCORES, json.dumps(RUNS)]
        done = subprocess.run(command, env=os.environ | processor, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        found.append(json.loads(done.stdout))
    assert sum(len(values) for _, values in found[0].values()) > 30
    for other in found[1:]:
        assert other == found[0]


def exact(A: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the exponential by its series in fractions of 400 binary digits."""
    n, unit = len(A), 2**400
    X = [[Fraction(value) for value in row] for row in A.tolist()]
    term = [[Fraction(int(i == j)) for j in range(n)] for i in range(n)]
    total = [list(row) for row in term]
    for k in range(1, 60):
        term = [
            [Fraction(round(sum(term[i][m] * X[m][j] for m in range(n)) / k * unit), unit) for j in range(n)]
            for i in range(n)
        ]
        total = [[a + b for a, b in zip(*rows, strict=True)] for rows in zip(total, term, strict=True)]
    return np.array([[float(value) for value in row] for row in total])


def test_exponential_of_a_stiff_axis() -> None:
    """Two masses on a screw, in units so different that the entries span 14 decades."""
    k, c, h = 1.5e8, 1900.0, 6.25e-5
    A = np.zeros((6, 6))
    A[0, 1] = A[2, 3] = 1.0
    A[1] = np.array([-k, -c - 60.0, k, c, 1.0, 0.0]) / 28.0
    A[3] = np.array([k, c, -k, -c - 20.0, 0.0, 1.0]) / 35.0
    np.testing.assert_allclose(exponential(A * h), exact(A * h), rtol=2e-15)


@pytest.mark.parametrize("size", [1e-9, 1e-3, 1.0, 7.0])
def test_exponential_of_any_matrix(size: float) -> None:
    A = size * np.random.default_rng(0).normal(size=(4, 4))
    expected = exact(A)
    np.testing.assert_allclose(exponential(A), expected, rtol=0, atol=2e-14 * np.abs(expected).max())
    np.testing.assert_array_equal(exponential(np.zeros((3, 3))), np.eye(3))
