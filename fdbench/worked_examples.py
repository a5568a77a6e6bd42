"""The worked examples of a docstring, executed."""

import doctest
import sys


def wrong_examples(cls: type) -> str:
    r"""Return what is wrong with the examples in the docstring of a class; nothing if all are right.

    >>> class Sheet:
    ...     ">>> 1 + 1\n3"
    >>> wrong_examples(Sheet).splitlines()[-1].strip()
    '2'
    """
    runner = doctest.DocTestRunner(verbose=False, optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    names = dict(vars(sys.modules[cls.__module__]))
    lines: list[str] = []
    for test in doctest.DocTestFinder(recurse=False).find(cls, cls.__name__, globs=names):
        runner.run(test, out=lines.append)
    return "".join(lines)
