"""JSON that a person can read: what fits on a line stands on one."""

import json
from typing import Any

_WIDTH = 120


def json_text(content: dict[str, Any]) -> str:
    """`content` as the text of a file, one entry a line or more."""
    return _broken(content, "") + "\n"


def _text(value: Any, indent: str, key: str) -> str:
    line = _line(value)
    fits = len(indent) + len(key) + len(line) < _WIDTH
    return line if fits or not isinstance(value, dict | list | tuple) else _broken(value, indent)


def _broken(value: Any, indent: str) -> str:
    inner = indent + "  "
    if isinstance(value, dict):
        keys = [f"{_line(key)}: " for key in value]
        entries, (left, right) = value.values(), "{}"
    else:
        keys = [""] * len(value)
        entries, (left, right) = value, "[]"
    parts = [f"{inner}{key}{_text(entry, inner, key)}" for key, entry in zip(keys, entries, strict=True)]
    return "\n".join([left, ",\n".join(parts), indent + right])


def _line(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)
