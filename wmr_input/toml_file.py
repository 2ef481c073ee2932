"""TOML file -> validated model; every mistake becomes one line with file, place, problem and remedy."""

import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from wmr_input.errors import FieldError, InputError, InputErrors, closest, nearest, plain, shown

LARGEST_FILE = 200_000  # bytes; a file that a person writes has a few thousand
DEEPEST_TABLE = 20  # levels of tables and lists, far below Python's recursion limit
_EXPECTED = {  # remedies for pydantic's types of errors
    "string_type": "text in quotes",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "float_parsing": "a number",
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "list_type": "a list in [ ]",
    "tuple_type": "a list in [ ]",
    "dict_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
}
Schema = TypeVar("Schema", bound=BaseModel)


def read_toml(path: Path, schema: type[Schema]) -> Schema:
    """The file at `path`, validated by `schema`.

    Raises:
        InputError: if the file cannot be read or has mistakes; one line for each.
    """
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise InputError(str(path), "", f"is larger than {LARGEST_FILE} bytes", "name a TOML text file")
        data = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise InputError(str(path), "", "no such file", "check the path") from None
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not UTF-8 text"
        raise InputError(str(path), "", f"cannot be read ({reason})", "name a TOML text file") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(str(path), "", f"not valid TOML: {error}", "mend the syntax there") from None
    except (RecursionError, ValueError):  # also integers of more digits than Python reads
        raise InputError(str(path), "", "nested too deeply or with numbers too long", "flatten the tables") from None
    if _depth(data) > DEEPEST_TABLE:
        raise InputError(str(path), "", "nested too deeply", "flatten the tables")
    return validate(data, schema, str(path))


def validate(data: dict[str, Any], schema: type[Schema], file: str) -> Schema:
    """`data` as `schema`.

    A file that has none of the tables that `schema` requires is another kind of file: that is one mistake, and the
    schema's `instead` says what to do, if it has one.

    Raises:
        InputError: if `data` does not fit; `file` is named in the text.
    """
    try:
        return schema.model_validate(data)
    except ValidationError as error:
        tables = _required_tables(schema)
        if len(tables) > 1 and not any(name in data for name in tables):
            kind = re.sub("(?<=[a-z])(?=[A-Z])", " ", schema.__name__).lower()
            problem = f"is no {kind}: it has no {', no '.join(f'[{name}]' for name in tables)}"
            raise InputError(file, "", problem, getattr(schema, "instead", "name another file")) from None
        details = _without_misspelt(error.errors(include_url=False), schema)
        mistakes = [InputError(file, place(one["loc"], data), *_explained(one, schema)) for one in details]
        raise (mistakes[0] if len(mistakes) == 1 else InputErrors(mistakes)) from None


def place(location: tuple[int | str, ...], data: Any) -> str:
    """The place in the file, as its author would write it: `[[wheels]] 'right' radius` or `[parameters] r.value`."""
    if not location:
        return ""
    table, *rest = (part if isinstance(part, int) else plain(part) for part in location)
    inside = data.get(location[0]) if isinstance(data, dict) else None
    if not rest:
        return f"[[{table}]]" if isinstance(inside, list) else f"[{table}]" if isinstance(inside, dict) else str(table)
    if isinstance(inside, list) and isinstance(rest[0], int):
        item = inside[rest[0]] if rest[0] < len(inside) else None
        if isinstance(item, dict):
            name = item.get("name", item.get("input"))
            head = f"[[{table}]] " + (repr(name) if isinstance(name, str) else f"number {rest[0] + 1}")
        else:
            head = f"{table} number {rest[0] + 1}"
        rest, inside = rest[1:], item
    else:
        head = f"[{table}]"
    return f"{head} {_below(rest, inside)}".strip()


def _below(rest: Sequence[int | str], data: Any) -> str:
    """A place within a table: `pieces number 2 circle.radius`; a list of tables is counted from one."""
    text = ""
    for part in rest:
        try:
            data = data[part]
        except (LookupError, TypeError):  # a key that is missing
            data = None
        if isinstance(part, int) and isinstance(data, dict):
            text += f" number {part + 1} "
        else:
            text += f".{part}" if text and not text.endswith(" ") else str(part)
    return text.strip()


def _depth(data: Any) -> int:
    """How deep tables and lists are nested; stops counting once it is too deep."""
    level, depth = [data], 0
    while level and depth <= DEEPEST_TABLE:
        level = [inner for one in level if isinstance(one, dict) for inner in one.values()] + [
            inner for one in level if isinstance(one, list) for inner in one
        ]
        depth += 1
    return depth


def _explained(error: ErrorDetails, schema: type[BaseModel]) -> tuple[str, str]:
    """Problem and remedy of one of pydantic's errors."""
    kind, context = error["type"], error.get("ctx", {})
    key = str(error["loc"][-1]) if error["loc"] else ""
    got = shown(error["input"])
    if kind == "extra_forbidden":
        return f"unknown key {shown(key)}", closest(key, _keys(schema, error["loc"][:-1]))
    if kind == "missing":
        return f"missing {shown(key)}", f"add {key} = ..."
    if kind == "value_error":
        wrong = context["error"]
        return (wrong.problem, wrong.remedy) if isinstance(wrong, FieldError) else (str(wrong), "")
    if kind == "string_too_short":
        return "is empty", "write an expression or a name"
    if kind == "string_too_long":
        return "is too long", f"use at most {context['max_length']} characters"
    if kind in ("too_short", "too_long"):
        bound = context.get("min_length", context.get("max_length"))
        return f"has {context.get('actual_length')} entries", f"give {bound}"
    if kind in ("literal_error", "enum", "union_tag_invalid"):
        return f"{got} is unknown", f"choose {context.get('expected', context.get('expected_tags'))}"
    if kind in _EXPECTED:
        return f"{got} does not fit", f"expected {_EXPECTED[kind]}"
    return f"{got} does not fit", error["msg"][:1].lower() + error["msg"][1:]


def _without_misspelt(details: list[ErrorDetails], schema: type[BaseModel]) -> list[ErrorDetails]:
    """The errors without missing keys that were misspelt: those are reported once, as unknown keys."""
    unknown = [one["loc"] for one in details if one["type"] == "extra_forbidden"]
    meant = {(*loc[:-1], nearest(str(loc[-1]), _keys(schema, loc[:-1]))) for loc in unknown}
    return [one for one in details if one["type"] != "missing" or one["loc"] not in meant]


def _required_tables(schema: type[BaseModel]) -> list[str]:
    """The keys of the tables, and lists of tables, without which nothing fits `schema`."""
    fields = schema.model_fields.items()
    return [name for name, field in fields if field.is_required() and field.annotation not in (str, int, float, bool)]


def _keys(schema: type[BaseModel], location: tuple[int | str, ...]) -> list[str]:
    """The keys that `schema` knows at `location`."""
    current: Any = schema
    for part in location:
        if isinstance(current, type) and issubclass(current, BaseModel):
            field = current.model_fields.get(str(part))
            current = field.annotation if field else _of_others(current)
        else:  # an entry of a list or a table: its element type
            current = (get_args(current) or (None,))[-1]
        current = _without_none(current)
    if isinstance(current, type) and issubclass(current, BaseModel):
        return [field.alias or name for name, field in current.model_fields.items()]
    return []


def _of_others(schema: type[BaseModel]) -> Any:
    """The type of the values of a table whose keys are free; None if they are not."""
    is_free = schema.model_config.get("extra") == "allow"
    return get_args(get_type_hints(schema)["__pydantic_extra__"])[-1] if is_free else None


def _without_none(annotation: Any) -> Any:
    if get_origin(annotation) in (list, dict, tuple):
        return annotation
    options = [option for option in get_args(annotation) if option is not type(None)]
    return options[0] if options else annotation
