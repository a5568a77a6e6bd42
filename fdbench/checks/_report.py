"""Run a list of checks and honour the failures that a plug-in announces with a reason."""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

from fdbench.errors import FdbenchError, PluginError
from fdbench.sandbox import Misbehaved


class NotApplicable(Exception):
    """A check has nothing to say of a plug-in, for the reason that is its message."""


def run_checks(
    name: str,
    checks: Sequence[tuple[str, Callable[[], None]]],
    expected: Mapping[str, str] = MappingProxyType({}),
) -> list[str]:
    """Return one line for each check; raise a PluginError that lists all failures, up to a crash, and what passed.

    ``expected`` has the reasons of failures that the plug-in announces, by the name of the check.
    """
    unknown = set(expected) - {check for check, _ in checks}
    lines, failures = [], [f"expected_failures names {item}, which is no check" for item in sorted(unknown)]
    for check, function in checks:
        try:
            function()
        except NotApplicable as error:
            lines.append(f"{check}: does not apply ({error})")
        except Exception as error:  # noqa: BLE001 - whatever a plug-in raises is a finding
            if check in expected:
                lines.append(f"{check}: fails as announced ({expected[check]})")
                continue
            text = str(error).removeprefix("PluginError: ") if isinstance(error, FdbenchError) else repr(error)
            failures.append(f"{check}: {text}")
            if isinstance(error, Misbehaved) or not isinstance(error, FdbenchError):
                break  # what has crashed once will again: further checks would name the same cause
        else:
            if check in expected:
                failures.append(f"{check}: passes, but expected_failures says: {expected[check]}")
            lines.append(f"{check}: ok")
    if failures:
        passed = [line.removesuffix(": ok") for line in lines if line.endswith(": ok")]
        failures += [f"Passed: {', '.join(passed)}."] if passed else []
        raise PluginError(f"{name}: " + "\n".join(failures))
    return lines
