"""Write how sure the diagnosis is on axes without a cause and with one, from opened trials that it did not learn from.

`python benchmarks/exchangeable_axes.py FOLDER KEY ANSWERS [FOLDER KEY ANSWERS ...]`, with the answers of `fdbench trial
answer FOLDER --diagnoser fdbench`. The files are read by `fdbench.diagnosis.judge.false_alarms` and `.cause_sets`.
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fdbench.diagnosis.judge import cause_sets, false_alarms
from fdbench.files import write_text
from fdbench.trials import seal
from fdbench.trials.make import read_manifest
from fdbench.trials.score import check_key

Case = tuple[Mapping[str, Any], Mapping[str, Any]]  # truth and answer


def main() -> None:
    """Read trials, keys and answers, and write the files."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trials", nargs="+", type=Path, metavar="FOLDER KEY ANSWERS")
    given = parser.parse_args()
    if len(given.trials) % 3:
        parser.error("a folder, its key and its answers are needed of each trial.")
    trials = list(zip(*(given.trials[place::3] for place in range(3)), strict=True))
    found = [opened(trial) for trial in trials]
    write(false_alarms.FILE, "surest", "without a cause", [(name, without(cases)) for name, cases in found])
    write(cause_sets.FILE, "truth", "with one cause", [(name, with_one(cases)) for name, cases in found])


def opened(trial: Sequence[Path]) -> tuple[str, list[Case]]:
    """Return what a trial is called by, and truth and answer of each case that was answered."""
    folder, key, answers = trial
    manifest, known = read_manifest(folder), seal.read_json(key, "the key of a trial")
    check_key(folder, manifest, known, key)
    answered = seal.read_json(answers, "answers of a trial")["cases"]
    truths = {name: case["truth"] for name, case in known["cases"].items()}
    cases = [(truth, answered[name]) for name, truth in truths.items() if answered[name]["status"] == "ok"]
    return f"tier {manifest['tier']}, {{}} axes, nonce {known['nonce']}", cases


def without(cases: Sequence[Case]) -> list[tuple[float, float]]:
    """Return the probabilities of the surest and of an unknown cause on axes without a cause."""
    return [
        (max(answer["effects"].values()), answer["unknown"])
        for truth, answer in cases
        if not truth["listed"] and not truth["unlisted"]
    ]


def with_one(cases: Sequence[Case]) -> list[tuple[float, float]]:
    """Return the probabilities of the true and of an unknown cause on axes with one cause that the library has."""
    return [
        (answer["effects"][truth["listed"][0]["name"]], answer["unknown"])
        for truth, answer in cases
        if len(truth["listed"]) == 1 and not truth["unlisted"]
    ]


def write(file: Path, column: str, words: str, found: Sequence[tuple[str, list[tuple[float, float]]]]) -> None:
    """Write the probabilities of axes to a file."""
    source = "; ".join(name.format(len(rows)).replace("axes", f"axes {words}") for name, rows in found)
    columns = zip((column, "unknown"), zip(*(row for _, rows in found for row in rows), strict=True), strict=True)
    lines = [f"{name} = [{', '.join(f'{value:.4f}' for value in sorted(values))}]" for name, values in columns]
    write_text(file, "\n".join([f'source = "{source}"', *lines]) + "\n")


if __name__ == "__main__":
    main()
