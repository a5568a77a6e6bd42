"""What every plug-in's data sheet must have, and that its examples are right."""

from fdbench.errors import PluginError
from fdbench.worked_examples import wrong_examples


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
    wrong = wrong_examples(cls)
    if wrong:
        raise PluginError(f"the example in the docstring is wrong:\n{wrong}")
