"""Selections of scenarios by name."""

from enum import StrEnum


class Suite(StrEnum):
    """Selections of scenarios: two of drawn machines, and the published trials that these were made of."""

    QUICK = "quick"
    FULL = "full"
    PUBLISHED = "published"


SEEDS = {Suite.QUICK: 3, Suite.FULL: 10, Suite.PUBLISHED: 3}


def in_suite(suite: Suite) -> list[str]:
    """Return the ids of a suite; of several versions the newest counts, the others are published trials."""
    from fdbench.catalogue import newest_ids, scenario_ids
    from fdbench.scenario import load_scenario

    newest = newest_ids()
    if suite is Suite.PUBLISHED:
        return [name for name in scenario_ids() if name not in newest]
    return [name for name in newest if suite in load_scenario(name).suites]
