"""Filling the templates beside this module."""

from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

_ENVIRONMENT = Environment(  # the output is code and Markdown, not HTML: nothing to escape
    loader=PackageLoader("derive.printing"),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    autoescape=False,  # noqa: S701
)


def render(template: str, **context: Any) -> str:
    """The text of a template, ending in one line feed."""
    return _ENVIRONMENT.get_template(template).render(**context).rstrip("\n") + "\n"
