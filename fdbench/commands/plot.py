"""``fdbench plot``."""

from pathlib import Path
from typing import Annotated

import typer

from fdbench.commands._options import file_to_write
from fdbench.errors import SpecError


def plot(
    records: Annotated[list[Path], typer.Argument(help="CSV, Parquet, MAT or mapping TOML files.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", callback=file_to_write, help="File to write: .html or .svg.")
    ] = Path("plot.html"),
    column: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Column to draw; may be repeated. Default: all.")
    ] = None,
    data: Annotated[Path | None, typer.Option(help="Folder of the files that mapping TOMLs name.")] = None,
) -> None:
    """Draw records: every column over time, one page or SVG file that needs no network."""
    from fdbench.reading import read_record
    from fdbench.report.record import write_plot

    if data is not None and not any(path.suffix.lower() == ".toml" for path in records):
        raise SpecError(f"--data {data}: a folder for mapping files (.toml), but no record is one.")
    read = [read_record(path, data if path.suffix.lower() == ".toml" else None) for path in records]
    write_plot(read, output, column or ())
