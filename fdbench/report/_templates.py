"""Pages and their parts from the templates beside: plain text is escaped wherever it goes in, `Html` is not."""

from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

from markupsafe import Markup as Html

if TYPE_CHECKING:
    from jinja2 import Environment

__all__ = ["Html", "part", "rendered", "resource"]


@cache
def _environment() -> "Environment":
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader("fdbench.report")
    return Environment(
        autoescape=True, keep_trailing_newline=True, loader=loader, lstrip_blocks=True, trim_blocks=True,
        undefined=StrictUndefined,
    )  # fmt: skip


def rendered(template: str, **values: object) -> Html:
    """Return a template with its values."""
    return Html(_environment().get_template(template).render(values))


def part(macro: str, *values: object) -> Html:
    """Return what a macro of ``parts.html`` makes of its values.

    >>> part("strong", "1 < 2"), part("strong", Html("<i>1</i>"))
    (Markup('<strong>1 &lt; 2</strong>'), Markup('<strong><i>1</i></strong>'))
    """
    return Html(getattr(_parts(), macro)(*values))


@cache
def _parts() -> object:
    return _environment().get_template("parts.html").module


def resource(name: str) -> Html:
    """Return a file of the folder of templates as it is."""
    return Html(files("fdbench.report").joinpath("templates", name).read_text("utf-8"))
