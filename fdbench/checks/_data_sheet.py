"""What every plug-in's data sheet must have, and that its examples are right."""

from fdbench.errors import raise_all
from fdbench.worked_examples import wrong_examples


def check_data_sheet(cls: type, parts: tuple[str, ...]) -> None:
    """Raise a PluginError unless the docstring has these parts and its examples, if any, are right.

    Parameters
    ----------
    cls : type
    parts : tuple of str
        Such as ``.. math::``, ``Source:`` or ``>>> ``.
    """
    lacking = [f"'{part.strip()}'" for part in parts if part not in (cls.__doc__ or "")]
    wrong = wrong_examples(cls)
    misses = [f"the docstring lacks {', '.join(lacking)}."] if lacking else []
    misses += [f"the example in the docstring is wrong:\n{wrong}"] if wrong else []
    raise_all(misses)
