"""Whatever a description holds, it ends in a robot or in mistakes of one line each, never in a traceback."""

import json
import signal
import tempfile
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from derive.codegen.write import generate_one, write
from derive.derivation import derive_robot
from derive.description.tables import FUNCTION_NAMES
from tests.conftest import DESCRIPTIONS
from tests.fuzzing import short
from wmr_afl.model.laws import Situation
from wmr_input import InputError

GOOD = {name: DESCRIPTIONS[name].read_text() for name in ("type_2_0", "mecanum", "type_1_1", "type_2_0_caster")}
TABLES = {name: tomllib.loads(text) for name, text in GOOD.items()}
PATIENCE = 60  # seconds that one description may take
Place = tuple[str | int, ...]  # of a value in nested tables and lists


def reported_well(content: bytes, derive: Callable[[Path], Any] = derive_robot) -> Any:
    """What a file of this content gives, or an InputError with one line a mistake; nothing is written, it ends soon."""
    with tempfile.TemporaryDirectory() as folder, in_time():
        path = Path(folder) / "robot.toml"
        path.write_bytes(content)
        found = None
        try:
            found = derive(path)
        except InputError as error:
            for line in str(error).splitlines() or [""]:
                assert line.startswith(f"{path}: "), f"{line!r} does not start with the file"
                problem, _, remedy = line.removeprefix(f"{path}: ").partition("; ")
                assert problem, f"{line!r} says no mistake"
                assert remedy, f"{line!r} says no remedy"
        assert [(one.name, one.read_bytes()) for one in Path(folder).iterdir()] == [("robot.toml", content)]
        return found


@contextmanager
def in_time() -> Iterator[None]:
    """A failure after PATIENCE, where the system has alarms."""
    if not hasattr(signal, "setitimer"):
        yield
        return
    before = signal.signal(signal.SIGALRM, lambda *_: pytest.fail(f"took more than {PATIENCE} s"))
    signal.setitimer(signal.ITIMER_REAL, PATIENCE)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


# --- lines -----------------------------------------------------------------------------------------------------------

FRAGMENTS = sorted({line.strip() for text in GOOD.values() for line in text.splitlines() if line.strip()})
LINES = st.one_of(
    st.text(max_size=40),
    st.sampled_from(FRAGMENTS),
    st.sampled_from(
        ["[[", "]]", "[frames]", "[[frames.x]]", "= 1", "a = ", "a.b.c = 1", '"""', "'''", "{ a = 1", "\x00"]
    ),
    st.integers(1, 3000).map(lambda depth: "a = " + "[" * depth + "]" * depth),
    st.integers(1, 6000).map(lambda digits: "a = " + "9" * digits),
    st.integers(1, 6000).map(lambda depth: ".".join("a" * depth) + " = 1"),
)
LINES_OF_JUNK = st.lists(LINES, max_size=200).map("\n".join).map(str.encode)

# --- tables ----------------------------------------------------------------------------------------------------------


class Verbatim(str):
    """A value as it stands in TOML."""

    __slots__ = ()


def as_toml(value: Any) -> str:
    """A value as TOML writes it inline."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{quoted(key)} = {as_toml(one)}" for key, one in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(as_toml, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    return quoted(value) if isinstance(value, str) and not isinstance(value, Verbatim) else str(value)


def quoted(text: str) -> str:
    """Text as TOML writes it in quotes."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def as_file(tables: dict[str, Any]) -> bytes:
    """Tables as the TOML file that holds them."""
    return "\n".join(f"{quoted(key)} = {as_toml(value)}" for key, value in tables.items()).encode()


def places(value: Any, here: Place = ()) -> list[Place]:
    """The places inside nested tables and lists that hold something."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [place for key, one in items for place in [(*here, key), *places(one, (*here, key))]]


def at(value: Any, place: Place) -> Any:
    """What stands at `place`."""
    for key in place:
        value = value[key]
    return value


KEYS = sorted({str(key) for tables in TABLES.values() for place in places(tables) for key in place})
TEXTS = sorted({str(at(tables, place)) for tables in TABLES.values() for place in places(tables)} - {""}, key=len)[:200]
DECLARED = ["x", "y", "phi", "beta", "r", "b", "d", "L", "a", "K1", "m_w", "I_m", "pi"]
WORDS = st.one_of(
    st.sampled_from(KEYS),
    st.sampled_from(TEXTS),
    st.text(max_size=12),
    st.sampled_from(
        ["", " ", "a\nb", "a\u2028b", "\x85", "class", "pi", "sin", "x_dot", "K_1", "é", "m^2", "a" * 41, "a; b"]
    ),
)

# --- expressions -----------------------------------------------------------------------------------------------------

NUMBERS = ["0", "1", "-1", "2", "0.5", "1/3", "1e300", "1e-300", "0.1234567891234", "0x1f", "1_0", "1j", "True", "pi"]
NAMES = st.sampled_from([*DECLARED, *DECLARED, "x_dot", "y_dot", "phi_dot", "sin", "nowhere", "E", "I", "_", "é"])
UNARY = [
    "-({})",
    "+{}",
    "({})**2",
    "({})**-1",
    "({})**0.5",
    "({})**(1/2)",
    "({})**64",
    "({})**3",
    "1/({})",
    "~{}",
    "{}()",
]
BINARY = [
    "{} + {}",
    "({}) - ({})",
    "{}*{}",
    "({})*({})",
    "({})/({})",
    "({})**({})",
    "{} {}",
    "{} if {} else 1",
    "{}^{}",
    "{}, {}",
]


def larger(parts: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    """Expressions made of smaller ones."""
    functions = st.sampled_from(["abs", "log", "print", *FUNCTION_NAMES * 3])
    return st.one_of(
        st.builds(lambda name, part: f"{name}({part})", functions, parts),
        st.builds(lambda form, part: form.format(part), st.sampled_from(UNARY), parts),
        st.builds(lambda form, one, other: form.format(one, other), st.sampled_from(BINARY), parts, parts),
    )


WRAPPERS = ["sin({})", "exp({})", "sqrt({})", "({})", "-{}", "1/({})", "1/(1+{})", "({})**2", "x+{}", "x*{}", "(1+{})"]
NESTED = st.builds(
    lambda depth, form, inside: form.partition("{}")[0] * depth + inside + form.partition("{}")[2] * depth,
    st.integers(1, 3) | st.integers(150, 1000),
    st.sampled_from(WRAPPERS),
    NAMES,
)
EXPRESSIONS = st.one_of(
    st.recursive(NAMES | st.sampled_from(NUMBERS), larger, max_leaves=6),
    st.sampled_from(NUMBERS),
    NESTED,
    st.text(max_size=20),
    st.sampled_from(
        ["__import__('os')", "lambda: 1", "x.real", "x[0]", "f'{x}'", "'\\d'", "0_", "1if x else 2", "(x\n)"]
    ),
)

# --- values ----------------------------------------------------------------------------------------------------------

SCALARS = st.one_of(
    WORDS,
    EXPRESSIONS,
    st.integers(-3, 3),
    st.floats(),
    st.booleans(),
    st.sampled_from([0, -1, 0.0, -1.0, 1e300, 1e-300, 5e-324, 2**63]),
    st.sampled_from(
        ["2011-01-01", "07:30:00", "2011-13-41", "1e999", "0x" + "f" * 300, "0x" + "f" * 5000, "0b1", "''"]
    ).map(Verbatim),
)
VALUES = st.recursive(
    SCALARS, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(WORDS, inner, max_size=3), max_leaves=6
)
JUNK_TABLES = st.dictionaries(
    WORDS,
    VALUES
    | st.lists(st.dictionaries(WORDS, VALUES, max_size=4), max_size=3)
    | st.dictionaries(WORDS, VALUES, max_size=4),
    max_size=12,
)

# --- mutations -------------------------------------------------------------------------------------------------------


@st.composite
def mixed_lines(draw: st.DrawFn) -> bytes:
    """A good description with some of its lines deleted, doubled, swapped, or replaced."""
    lines = GOOD[draw(st.sampled_from(sorted(GOOD)))].splitlines()
    for _ in range(draw(st.integers(1, 3))):
        one, other = draw(st.integers(0, len(lines) - 1)), draw(st.integers(0, len(lines) - 1))
        match draw(st.sampled_from(["delete", "double", "swap", "replace"])):
            case "delete":
                del lines[one]
            case "double":
                lines.insert(other, lines[one])
            case "swap":
                lines[one], lines[other] = lines[other], lines[one]
            case "replace":
                lines[one] = draw(LINES)
    return "\n".join(lines).encode()


@st.composite
def mutated(draw: st.DrawFn, values: st.SearchStrategy[Any] = VALUES, most: int = 3) -> bytes:
    """A good description with some values deleted, renamed, exchanged, doubled, or replaced by `values`."""
    tables: dict[str, Any] = deepcopy(TABLES[draw(st.sampled_from(sorted(TABLES)))])
    for _ in range(draw(st.integers(1, most))):
        *inside, key = draw(st.sampled_from(places(tables)))
        table = at(tables, tuple(inside))
        match draw(st.sampled_from(["delete", "rename", "exchange", "double", "replace", "replace", "replace"])):
            case "delete":
                del table[key]
            case "rename" if isinstance(table, dict):
                table[draw(WORDS)] = table.pop(key)
            case "exchange":
                table[key] = deepcopy(at(tables, draw(st.sampled_from(places(tables)))))
            case "double" if isinstance(table, list):
                table.append(deepcopy(table[key]))
            case _:
                table[key] = draw(values)
        if not tables:
            break
    return as_file(tables)


NO_EXPRESSIONS = {"name", "title", "source", "coordinates", "parameters", "frame", "input", "drives", "parent", "known"}


def spots_of_expressions(tables: dict[str, Any]) -> list[Place]:
    """Where expressions stand."""
    return [p for p in places(tables) if isinstance(at(tables, p), str) and NO_EXPRESSIONS.isdisjoint(p)]


@st.composite
def with_expressions(draw: st.DrawFn) -> bytes:
    """A good description with other expressions in some places of expressions."""
    tables: dict[str, Any] = deepcopy(TABLES[draw(st.sampled_from(sorted(TABLES)))])
    for _ in range(draw(st.integers(1, 3))):
        *inside, key = draw(st.sampled_from(spots_of_expressions(tables)))
        at(tables, tuple(inside))[key] = draw(EXPRESSIONS)
    return as_file(tables)


ENVELOPES = [
    "-({})",
    "({})*0",
    "({})*2",
    "({})/3",
    "({})*pi",
    "({})*sqrt(2)",
    "({})*1e300",
    "({})*1e-300",
    "({}) - ({})",
]
ENVELOPES += [
    "sqrt(({})**2)",
    "sqrt({})",
    "(({})**2)**0.5",
    "({})**2",
    "1/({})",
    "({})**3",
    "({})*({})/({})",
    "({}) + ({})",
]
ENVELOPES += [
    f"({{}})*{name}({inner})" for name in FUNCTION_NAMES for inner in ("0", "1", "phi", "{}", "2*phi", "x/y", "b/r")
]
ENVELOPES += [
    "sin({})",
    "cos({})",
    "tan({})",
    "exp({})",
    "({}) + 1",
    "({}) + x",
    "({}) + r",
    "({})*x/y",
    "({})*b/r",
    "{}/(x - y)",
]
WHOLE = [
    "0",
    "1",
    "-1",
    "1e-300",
    "pi/2",
    "pi/4",
    "1/7",
    "sqrt(2)",
    "sqrt(2)/2",
    "x",
    "phi",
    "r",
    "2*r",
    "r*cos(1)",
    "x_dot",
    "phi_dot",
]
DEFAULTS = [0, 0.0, -1.0, 1e300, 1e-300, 5e-324, 1e-9, 1.0, 0.1, 3, 1e9]
FURTHER: list[tuple[str, Any]] = [
    ("constraints", {"expression": "x_dot"}),
    ("constraints", {"expression": "phi_dot - x_dot/r"}),
    ("constraints", {"expression": "x_dot*sin(phi) - y_dot*cos(phi)"}),
    ("constraints", {"expression": "x_dot*exp(x) + phi_dot*sqrt(x)"}),
    ("bodies", {"frame": "platform", "at": ["0", "b"], "mass": "1"}),
    ("wheels", {"name": "more", "frame": "platform", "at": ["r", "0"], "radius": "r"}),
    ("wheels", {"name": "more", "frame": "platform", "at": ["r", "b"], "radius": "r", "roller_angle": "pi/3"}),
    ("wheels", {"name": "more", "frame": "arm", "at": ["-r", "0"], "radius": "r"}),
    ("frames", {"name": "arm", "parent": "platform", "at": ["b", "0"], "angle": "phi"}),
    ("frames", {"name": "arm", "parent": "platform", "at": ["b", "0"], "angle": "gamma"}),
    ("motors", {"input": "u_more", "drives": "arm", "torque_gain": "K1"}),
    ("motors", {"input": "u_more", "drives": "more", "torque_gain": "1"}),
]


@st.composite
def reshaped(draw: st.DrawFn) -> bytes:
    """A good description with changes that look sound: what still means something goes deepest."""
    tables: dict[str, Any] = deepcopy(TABLES[draw(st.sampled_from(sorted(TABLES)))])
    for _ in range(draw(st.integers(1, 3))):
        match draw(st.sampled_from(["expression", "expression", "default", "delete", "more", "coordinate"])):
            case "expression":
                *inside, key = draw(st.sampled_from(spots_of_expressions(tables)))
                table = at(tables, tuple(inside))
                table[key] = draw(st.sampled_from([*ENVELOPES, *WHOLE])).replace("{}", table[key])
            case "default" if tables.get("parameters"):
                draw(st.sampled_from(list(tables["parameters"].values())))["value"] = draw(st.sampled_from(DEFAULTS))
            case "delete":
                removable = [p for p in places(tables) if len(p) == 2 or p[0] in ("wheels", "motors", "bodies")]
                *inside, key = draw(st.sampled_from([("title",), ("pseudo_velocities",), *removable]))
                if key in at(tables, tuple(inside)) or inside:
                    del at(tables, tuple(inside))[key]
            case "more":
                table_name, item = draw(st.sampled_from(FURTHER))
                tables.setdefault(table_name, []).append(dict(item))
            case "coordinate":
                tables["coordinates"][draw(st.sampled_from(["gamma", "z"]))] = draw(
                    st.sampled_from(["rad", "m", "s^3"])
                )
    return as_file(tables)


# --- the law ---------------------------------------------------------------------------------------------------------


@short(50)
@given(st.binary(max_size=200) | LINES_OF_JUNK)
def test_junk_lines_are_reported(content: bytes) -> None:
    reported_well(content)


@short(75)
@given(JUNK_TABLES.map(as_file))
def test_junk_tables_are_reported(content: bytes) -> None:
    reported_well(content)


@short(40)
@given(mixed_lines())
def test_mixed_lines_are_reported(content: bytes) -> None:
    reported_well(content)


@short(60)
@given(mutated())
def test_mutations_are_reported(content: bytes) -> None:
    reported_well(content)


@short(50)
@given(with_expressions())
def test_junk_expressions_are_reported(content: bytes) -> None:
    reported_well(content)


@short(30)
@given(reshaped())
def test_reshaped_robots_are_reported(content: bytes) -> None:
    reported_well(content)


# What longer searches found: a robot, and what is written in some of its places.
FOUND: dict[str, tuple[str, dict[Place, Any]]] = {
    "key of several lines": ("type_2_0", {("a\nb",): 1}),
    "parameter of several lines": ("type_2_0", {("parameters", "a\u2028b"): 1}),
    "key nested too deeply": ("type_2_0", {("name",): Verbatim("{ " + ".".join("a" * 5000) + " = 1 }")}),
    "integer of too many decimal digits": ("type_2_0", {("parameters", "r", "value"): Verbatim("9" * 5000)}),
    "integer of too many hexadecimal digits": ("type_2_0", {("parameters", "r", "value"): Verbatim("0x" + "f" * 5000)}),
    "expression that is a huge integer": ("type_2_0", {("bodies", 0, "mass"): Verbatim("0x" + "f" * 5000)}),
    "functions nested too deeply": ("type_2_0", {("outputs", "y1"): "sin(" * 200 + "x" + ")" * 200}),
    "mass beyond floating point": ("type_2_0", {("bodies", 0, "mass"): "1e300*1e300"}),
    "mass beyond printing": ("type_2_0", {("bodies", 0, "mass"): "1e300**64"}),
    "constant part beyond printing": ("type_2_0", {("constraints",): [{"expression": "x_dot + 1e300**64"}]}),
    "mass whose square is beyond floating point": ("type_2_0_caster", {("wheels", 2, "mass"): "1e300"}),
    "tiny offset": ("type_2_0", {("bodies", 0, "at"): ["1e-300", "0"]}),
    "huge radius": ("type_2_0_caster", {("wheels", 0, "radius"): "1e300"}),
    "huge default": ("mecanum", {("parameters", "d", "value"): 1e300}),
    "default below normal numbers": ("type_1_1", {("parameters", "L", "value"): 5e-324}),
    "transcendental position": ("type_2_0", {("bodies", 0, "at"): ["d*cos(0.5)", "d*sin(0.5)"]}),
    "transcendental joint": ("type_1_1", {("frames", 1, "at"): ["a*cos(0.5)", "0"]}),
    "powers of e in a joint": ("type_1_1", {("frames", 1, "at"): ["a*exp(1)", "0"]}),
    "transcendental radius": ("type_1_1", {("wheels", 1, "radius"): "r_r*cos(1)"}),
    "rollers at 0.5 rad": ("mecanum", {("wheels", 0, "roller_angle"): "0.5", ("wheels", 1, "radius"): "0.1"}),
    "absolute value in an output": ("type_2_0", {("outputs", "y2"): "sqrt((y + L*sin(phi))**2)"}),
    "absolute value in a position": ("type_2_0", {("frames", 0, "position"): ["x", "sqrt(y**2)"]}),
    "output singular on the straight line": ("type_2_0", {("outputs", "y2"): "(y + L*sin(phi))*sqrt(2*phi)"}),
    "root in a heading": ("type_1_1", {("frames", 0, "heading"): "phi*sqrt(phi)"}),
    "roots in roots": ("type_2_0", {("outputs", "y1"): "y*L + " + "sqrt(1+" * 10 + "x" + ")" * 10}),
}


@pytest.mark.parametrize("found", FOUND)
def test_what_was_found_is_reported_or_becomes_code_that_runs(found: str, tmp_path: Path) -> None:
    name, changes = FOUND[found]
    tables = deepcopy(TABLES[name])
    for (*inside, key), value in changes.items():
        at(tables, tuple(inside))[key] = value
    files = reported_well(as_file(tables), generate_one)
    if files is not None:
        write({f"{name}/{file}": text for file, text in files.items()}, tmp_path)
        has_finite_terms(tmp_path / name)


def has_finite_terms(folder: Path) -> None:
    """Every generated function is finite at some of the situations."""
    situation = Situation(folder)
    model = situation.numpy
    with np.errstate(all="ignore"):
        for name in model.metadata["functions"]:
            term = getattr(model, name)
            arguments = model.metadata["functions"][name]["arguments"]
            values = np.asarray(term(*(situation.arguments[one] for one in arguments)))
            assert np.isfinite(values.reshape(len(situation.x), -1)).all(axis=1).any(), f"{name} is not finite"
