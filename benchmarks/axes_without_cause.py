"""Write how sure the diagnosis is of a cause on axes that have none, from opened trials that it did not learn from.

`python benchmarks/axes_without_cause.py FOLDER KEY ANSWERS [FOLDER KEY ANSWERS ...] [--output FILE]`, with the answers
of `fdbench trial answer FOLDER --diagnoser fdbench`. The file is read by `fdbench.diagnosis.judge.false_alarms`.
"""

import argparse
from pathlib import Path

from fdbench.diagnosis.judge.false_alarms import FILE
from fdbench.files import write_text
from fdbench.trials import seal
from fdbench.trials.make import read_manifest
from fdbench.trials.score import check_key


def main() -> None:
    """Read trials, keys and answers, and write the file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trials", nargs="+", type=Path, metavar="FOLDER KEY ANSWERS")
    parser.add_argument("--output", type=Path, default=FILE)
    given = parser.parse_args()
    if len(given.trials) % 3:
        parser.error("a folder, its key and its answers are needed of each trial.")
    sources, surest, unknown = [], [], []
    for folder, key, answers in zip(*(given.trials[place::3] for place in range(3)), strict=True):
        manifest, opened = read_manifest(folder), seal.read_json(key, "the key of a trial")
        check_key(folder, manifest, opened, key)
        answered = seal.read_json(answers, "answers of a trial")["cases"]
        empty = [
            answered[name]
            for name, case in opened["cases"].items()
            if not case["truth"]["listed"] and not case["truth"]["unlisted"] and answered[name]["status"] == "ok"
        ]
        surest += [max(own["effects"].values()) for own in empty]
        unknown += [own["unknown"] for own in empty]
        sources.append(f"tier {manifest['tier']}, {len(empty)} axes without a cause, nonce {opened['nonce']}")
    lines = [
        f'source = "{"; ".join(sources)}"',
        *(
            f"{name} = [{', '.join(f'{value:.4f}' for value in sorted(values))}]"
            for name, values in (("surest", surest), ("unknown", unknown))
        ),
    ]
    write_text(given.output, "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
