"""What every plug-in's data sheet must have, and that its examples are right."""

import doctest
import sys

from fdbench.errors import PluginError


def check_data_sheet(cls: type, parts: tuple[str, ...]) -> None:
    """Raise a PluginError unless the docstring has these parts and its examples, if any, are right.

    Parameters
    ----------
    cls : type
    parts : tuple of str
        Such as ``.. math::``, ``Source:`` or ``>>> ``.
    """
    text = cls.__doc__ or ""
    lacking = [part.strip() for part in parts if part not in text]
    if lacking:
        raise PluginError(f"the docstring lacks '{lacking[0]}': equation, source and example are expected.")
    runner = doctest.DocTestRunner(verbose=False, optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    names = dict(vars(sys.modules[cls.__module__]))
    for test in doctest.DocTestFinder(recurse=False).find(cls, cls.__name__, globs=names):
        lines: list[str] = []
        runner.run(test, out=lines.append)
        if runner.failures:
            raise PluginError("the example in the docstring is wrong:\n" + "".join(lines))
