"""``fdbench record``."""

from pathlib import Path
from typing import Annotated

import typer

from fdbench.checks.plugin_files import add_effects
from fdbench.commands._options import SCENARIO, Effects, file_to_write, names_of
from fdbench.commands._say import say
from fdbench.errors import SpecError


def record(
    scenario: Annotated[str, typer.Argument(autocompletion=names_of(SCENARIO), help="Id or TOML file of a scenario.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", callback=file_to_write, help="File to write: .csv or .parquet.")
    ],
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noises.")] = 0,
    effect: Effects = None,
) -> None:
    """Simulate a scenario and write its record, what a logger on the machine would have written."""
    from fdbench.convergence import integration_doubt
    from fdbench.scenario import load_scenario

    add_effects(effect)
    chosen = load_scenario(scenario)
    try:
        chosen.record(seed).save(output)
        if Path(scenario).suffix == ".toml" and (doubt := integration_doubt(chosen)):
            say(f"fdbench: {doubt}", is_aside=True)
    except ArithmeticError as error:
        raise SpecError(f"{scenario}: these values cannot be computed with: {error}.") from error
