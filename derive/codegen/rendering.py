"""Filling templates: those beside this module, and those of a target language."""

import json
import textwrap
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

_WIDTH = 120
_TEMPLATES = Path(__file__).parent / "templates"


def _literal(value: object) -> str:
    """A Python literal, texts in double quotes."""
    return json.dumps(value, ensure_ascii=False)


def _docstring(text: str) -> str:
    """Text that can stand inside a docstring."""
    return text.replace("\\", "\\\\").replace('"', '\\"') if "\\" in text or '"""' in text else text


def _wrapped(value: object, indent: str, key: str = "") -> str:
    """A Python literal, a long text in several parts; `key` stands before it on its line."""
    whole = _literal(value)
    if len(indent) + len(key) + len(whole) + 3 <= _WIDTH or not isinstance(value, str):
        return whole
    width = _WIDTH - len(indent) - 8
    parts = [_literal(value[k : k + width]) for k in range(0, len(value), width)]
    return "\n".join(["(", *(f"{indent}    {part}" for part in parts), f"{indent})"])


def _filled(text: str) -> str:
    """Running text in lines of the usual width."""
    return textwrap.fill(text, _WIDTH, break_long_words=False, break_on_hyphens=False)


@cache
def _environment(folder: Path) -> Environment:
    environment = Environment(  # the output is code and Markdown, not HTML: nothing to escape
        loader=FileSystemLoader([folder, _TEMPLATES]),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        autoescape=False,  # noqa: S701
    )
    environment.filters |= {"literal": _literal, "docstring": _docstring, "wrapped": _wrapped, "filled": _filled}
    return environment


def render(template: str, folder: Path = _TEMPLATES, **context: Any) -> str:
    """The text of a template, ending in one line feed; it and what it includes may stand in `folder`."""
    return _environment(folder).get_template(template).render(**context).rstrip("\n") + "\n"
