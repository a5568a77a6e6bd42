"""Variants of estimators: ``name[argument=value,...]`` is the estimator ``name`` with arguments of one's own.

Such a text is the name of a row; the registry knows the part before the bracket alone.
"""

import math
import re
from collections.abc import Mapping
from itertools import product

from fdbench.errors import SpecError

Value = bool | int | float | str | None

LONGEST_NAME = 200  # a folder is named by it, and a file system has 255 bytes
MOST_VARIANTS = 1000  # beyond them a slip of the pen is likelier than a plan

_VARIANT = re.compile(r"(?P<estimator>.+)\[(?P<arguments>[^\[\]]*)\]")
_VALUE = re.compile(r"[\w.+-]+")
_WORDS: Mapping[str, Value] = {"true": True, "false": False, "none": None}


def registered(name: str) -> str:
    """Return the estimator, or its file, of which a name is a variant; the name itself if it is none.

    >>> registered("pl_lssvm[gamma=20]"), registered("pl_lssvm")
    ('pl_lssvm', 'pl_lssvm')
    """
    found = _VARIANT.fullmatch(name)
    return name if found is None else found["estimator"]


def arguments(name: str) -> dict[str, Value]:
    """Return the arguments of a variant by their names; of any other name none.

    >>> arguments("pl_lssvm[gamma=20,hyperparameters=given]")
    {'gamma': 20, 'hyperparameters': 'given'}
    """
    return {key: values[0] for key, values in _lists(name).items()}


def variants(text: str) -> list[str]:
    """Return the name of each variant that a text asks for; ``|`` divides values, each is tried with all others.

    Two spellings of one variant have one name: arguments are sorted, numbers written in one way.

    >>> variants("pl_lssvm[sigma_2=.5|1.0,gamma=2e1]")
    ['pl_lssvm[gamma=20,sigma_2=0.5]', 'pl_lssvm[gamma=20,sigma_2=1]']
    >>> variants("pl_lssvm")
    ['pl_lssvm']

    Raises
    ------
    SpecError
        If the brackets hold anything else, an argument is given twice, or there are more than ``MOST_VARIANTS``.
    """
    lists = _lists(text)
    if math.prod(map(len, lists.values())) > MOST_VARIANTS:
        raise SpecError(f"estimator '{text}': more than {MOST_VARIANTS} variants.")
    points = (dict(zip(lists, values, strict=True)) for values in product(*lists.values()))
    names = [variant(registered(text), point) for point in points]
    for name in names:
        if len(name.encode()) > LONGEST_NAME:
            raise SpecError(f"estimator '{name}': a name may have {LONGEST_NAME} bytes. Leave out some arguments.")
    return list(dict.fromkeys(names))


def variant(estimator: str, given: Mapping[str, Value]) -> str:
    """Return the name of an estimator with arguments.

    >>> variant("krls_t", {"mode": "UI", "budget": 20})
    'krls_t[budget=20,mode=UI]'
    """
    return f"{estimator}[{','.join(f'{key}={_text(given[key])}' for key in sorted(given))}]" if given else estimator


def _lists(name: str) -> dict[str, list[Value]]:
    found = _VARIANT.fullmatch(name)
    if found is None:
        return {}
    lists = dict[str, list[Value]]()
    for part in found["arguments"].split(","):
        key, _, values = (text.strip() for text in part.partition("="))
        if not key.isidentifier():
            raise SpecError(
                f"estimator '{name}': '{part.strip()}' in the brackets; argument=value is expected, several divided by "
                f"commas, as in {found['estimator']}[a=1,b=0.5|1|2]."
            )
        if key in lists:
            raise SpecError(f"estimator '{name}': argument '{key}' is given twice; 'a|b' tries two values.")
        lists[key] = [_value(text.strip(), key, name) for text in values.split("|")]
    return lists


def _value(text: str, key: str, name: str) -> Value:
    if not _VALUE.fullmatch(text):
        raise SpecError(
            f"estimator '{name}': {key}={text}: a number, true, false, none or a word is expected. Other values are "
            "given in the scenario's [estimation.hyperparameters], or by a class of your own."
        )
    if text in _WORDS:
        return _WORDS[text]
    try:
        number = float(text)
    except ValueError:
        return text
    # 1, 1.0 and 1e0 are one number, and one row.
    return int(number) if number.is_integer() and abs(number) < 2**53 else number


def _text(value: Value) -> str:
    return next((word for word, meant in _WORDS.items() if value is meant), str(value))
