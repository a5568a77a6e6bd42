"""Which estimators a run is asked for: rows by name, the files that each is made of, and what it is made for."""

import inspect
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from fdbench.benchmark import oracle
from fdbench.benchmark.job import Choice, sandbox
from fdbench.benchmark.provenance import digest, estimator_digest, estimator_source, plugin_files, source_files
from fdbench.benchmark.store import Store
from fdbench.benchmark.variant import arguments, registered, variant, variants
from fdbench.errors import PluginError
from fdbench.estimator import estimators as registry
from fdbench.sandbox import Misbehaved, WorkerLimits, own_files
from fdbench.scenario import Scenario

NULL = "null"


def select(names_or_files: Sequence[str]) -> tuple[str, ...]:
    """Return the rows of a selection, references included, in order of name; files are noted, not imported."""
    names = {_row(text) for given in names_or_files if given != oracle.NAME for text in variants(given)} | {NULL}
    wanted = {registered(name) for name in names}
    if oracle.NAME in (*wanted, *registry.names()):
        raise PluginError(f"estimator '{oracle.NAME}': this name is the benchmark's own. Rename the file.")
    for name in wanted.difference(registry.names()):
        registry.get(name)
    return tuple(sorted({*names, oracle.NAME}))


def _row(text: str) -> str:
    """Return the name of a row: a file is called by its stem."""
    return variant(registry.declare(registered(text)), arguments(text))


def construct_variants(
    names: Iterable[str],
    sources: Mapping[str, Sequence[Path]],
    limits: WorkerLimits,
    plugins: tuple[tuple[int, Path], ...],
) -> None:
    """Construct each variant once, so that one that refuses its arguments does so before anything is run.

    One that cannot even be imported is left to its run, which reports it.
    """
    for name in names:
        if given := arguments(name):
            estimator = registered(name)
            try:
                worker = sandbox(limits, plugins).worker(estimator_source(estimator, sources[estimator]))
                worker.load()
            except Misbehaved:
                continue
            try:
                worker.construct(given)
            except Misbehaved as error:
                text = str(error).removeprefix("PluginError: ").removeprefix("SpecError: ")
                raise PluginError(f"estimator '{name}': {text}") from error


def made_for(
    sources: Mapping[str, Sequence[Path]], limits: WorkerLimits, plugins: tuple[tuple[int, Path], ...], store: Store
) -> dict[str, tuple[str, ...] | None]:
    """Return what each estimator is made for, None for anything; what is known of its very code is not asked again.

    One that cannot be imported is for anything, so that each of its runs reports it.
    """
    known, found = store.made_for(), dict[str, tuple[str, ...] | None]()
    for name, files in sources.items():
        content = estimator_digest(files, {})
        if content not in known:
            try:
                known[content] = sandbox(limits, plugins).worker(estimator_source(name, files)).load().made_for
            except Misbehaved:
                found[name] = None
                continue
        found[name] = known[content]
    store.write_made_for({content: known[content] for content in sorted(known)})
    return found


def sources_of(names: Iterable[str]) -> dict[str, list[Path]]:
    """Return the files that each estimator of some rows is made of; reading them takes a while."""
    by_path, modules = plugin_files(registry), registry.modules()
    others = sorted({registered(name) for name in names} - {oracle.NAME})
    return {name: list(own_files(by_path[name])) if name in by_path else source_files(modules[name]) for name in others}


def choice_of(name: str, scenario: Scenario, sources: Mapping[str, Sequence[Path]]) -> Choice:
    """Return the estimator of a row, with its arguments over those that the scenario has for it."""
    if name == oracle.NAME:
        return Choice(name=name, arguments={}, digest=digest([inspect.getsource(oracle).encode()]))
    own, files = arguments_of(name, scenario), sources[registered(name)]
    source = estimator_source(registered(name), files)
    file = "" if source.file is None else str(source.file)
    return Choice(name=name, arguments=own, digest=estimator_digest(files, own), source=source, file=file)


def arguments_of(name: str, scenario: Scenario) -> dict[str, Any]:
    """Return the arguments of the estimator of a row: its own over those that the scenario has for it."""
    return {**scenario.estimation.hyperparameters.get(registered(name), {}), **arguments(name)}
