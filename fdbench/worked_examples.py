"""The worked examples of a docstring, executed by the rules of this repository's tests."""

import doctest
import re
import sys

# That of pytest: a number has to be right in the digits that are written.
NUMBER = doctest.register_optionflag("NUMBER")

RULES = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE | NUMBER

_NUMBER = re.compile(r"[+-]?(?:\d*\.(?P<fraction>\d+)|\d+\.|\d+(?=[Ee]))(?:[Ee](?P<exponent>[+-]?\d+))?")


def wrong_examples(cls: type) -> str:
    r"""Return what is wrong with the examples in the docstring of a class; nothing if all are right.

    >>> class Sheet:
    ...     ">>> 1 + 1\n3\n>>> 2 / 3\n0.67"
    >>> wrong_examples(Sheet).splitlines()[-1].strip()
    '2'
    """
    runner = doctest.DocTestRunner(_Checker(), verbose=False, optionflags=RULES)
    names = dict(vars(sys.modules[cls.__module__]))
    lines: list[str] = []
    for test in doctest.DocTestFinder(recurse=False).find(cls, cls.__name__, globs=names):
        runner.run(test, out=lines.append)
    return "".join(lines)


class _Checker(doctest.OutputChecker):
    def check_output(self, want: str, got: str, optionflags: int) -> bool:
        return super().check_output(want, as_written(want, got) if optionflags & NUMBER else got, optionflags)


def as_written(want: str, got: str) -> str:
    """Return an output with those of its numbers as in the wanted one that are right in the digits written there.

    A number without point and exponent has to be right exactly.

    >>> as_written("[0.67, 1e3, 2]", "[0.6666, 1400.0, 3]")
    '[0.67, 1e3, 3]'
    >>> as_written("0.67 N", "0.7 N")
    '0.7 N'
    """
    wanted, found = list(_NUMBER.finditer(want)), list(_NUMBER.finditer(got))
    if len(wanted) != len(found):
        return got
    for right, left in reversed(list(zip(wanted, found, strict=True))):
        digits = len(right["fraction"] or "") - int(right["exponent"] or 0)
        if abs(float(right[0]) - float(left[0])) <= 10.0**-digits:
            got = got[: left.start()] + right[0] + got[left.end() :]
    return got
