"""Filling the templates beside this module."""

import json
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

_ENVIRONMENT = Environment(  # the output is code and Markdown, not HTML: nothing to escape
    loader=PackageLoader("derive.printing"),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    autoescape=False,  # noqa: S701
)


def _literal(value: object) -> str:
    """A Python literal, texts in double quotes."""
    return json.dumps(value, ensure_ascii=False)


def _docstring(text: str) -> str:
    """Text that can stand inside a docstring."""
    return text.replace("\\", "\\\\").replace('"', '\\"') if "\\" in text or '"""' in text else text


_ENVIRONMENT.filters |= {"literal": _literal, "docstring": _docstring}


def render(template: str, **context: Any) -> str:
    """The text of a template, ending in one line feed."""
    return _ENVIRONMENT.get_template(template).render(**context).rstrip("\n") + "\n"
