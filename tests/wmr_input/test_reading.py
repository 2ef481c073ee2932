"""TOML files are read within bounds, and each mistake is a line with file, place, problem and remedy."""

import pickle
from pathlib import Path
from typing import ClassVar

import pytest
from pydantic import Field

from wmr_input import InputError, WmrError, closest, nearest, read_toml
from wmr_input.errors import FieldError, InputErrors, mistakes_at
from wmr_input.fields import ByName, Estimate, Gain, Named, NotNegative, Number, Numbers, Positive, Table
from wmr_input.toml_file import DEEPEST_TABLE, LARGEST_FILE, place, validate


class Wheel(Table):
    name: str = ""
    radius: Positive = 1.0
    mass: NotNegative = 0.0


class Robot(Table):
    title: str
    count: int = 0
    is_fast: bool = False
    about: str = Field(default="", max_length=5)
    wheels: list[Wheel] = Field(default_factory=list)
    limits: dict[str, float] = Field(default_factory=dict)
    pair: list[float] = Field(default_factory=list, max_length=2)
    name: str = Field(default="a", min_length=1)
    inner: Wheel | None = None


def mistake(text: str, tmp_path: Path) -> str:
    path = tmp_path / "robot.toml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_toml(path, Robot)
    return str(caught.value).replace(str(tmp_path) + "/", "")


class RobotTask(Table):
    instead: ClassVar[str] = "name a task"
    title: str
    wheels: list[Wheel]
    limits: dict[str, float]


@pytest.mark.parametrize("text", ["", 'title = "a"', 'guess = "a"\n[parameters]\nr = 1.0'])
def test_another_kind_of_file_is_one_mistake(text: str, tmp_path: Path) -> None:
    """It has none of the tables that are required; with one of them what is missing is told."""
    path = tmp_path / "task.toml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_toml(path, RobotTask)
    assert str(caught.value) == f"{path}: is no robot task: it has no [wheels], no [limits]; name a task"
    path.write_text("[limits]\n" + 'title = "a"')
    with pytest.raises(InputErrors, match="wheels: missing 'wheels'"):
        read_toml(path, RobotTask)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "robot.toml: title: missing 'title'; add title = ..."),
        ("title = 1", "robot.toml: title: 1 does not fit; expected text in quotes"),
        ('title = "a"\ncount = 1.5', "robot.toml: count: 1.5 does not fit; expected a whole number"),
        ('title = "a"\nis_fast = 1', "robot.toml: is_fast: 1 does not fit; expected true or false"),
        ('title = "a"\nwheels = 1', "robot.toml: wheels: 1 does not fit; expected a list in [ ]"),
        ('title = "a"\nlimits = 1', "robot.toml: limits: 1 does not fit; expected a table"),
        ('title = "a"\ninner = 1', "robot.toml: inner: 1 does not fit; expected a table"),
        ('title = "a"\n[limits]\na = "x"', "robot.toml: [limits] a: 'x' does not fit; expected a number"),
        ('title = "a"\nname = ""', "robot.toml: name: is empty; write an expression or a name"),
        ('title = "a"\nabout = "abcdef"', "robot.toml: about: is too long; use at most 5 characters"),
        ('title = "a"\npair = [1.0, 2.0, 3.0]', "robot.toml: [[pair]]: has 3 entries; give 2"),
        ('title = "a"\ntitel = "b"', "robot.toml: titel: unknown key 'titel'; did you mean 'title'?"),
        ('titel = "b"', "robot.toml: titel: unknown key 'titel'; did you mean 'title'?"),
        (
            'title = "a"\n[[wheels]]\nname = "left"\nradius = -1.0',
            "robot.toml: [[wheels]] 'left' radius: -1.0 does not fit; input should be greater than 0",
        ),
        (
            'title = "a"\n[[wheels]]\n[[wheels]]\nmass = -1.0',
            "robot.toml: [[wheels]] number 2 mass: -1.0 does not fit; input should be greater than or equal to 0",
        ),
        (
            'title = "a"\n[[wheels]]\nradus = 1.0',
            "robot.toml: [[wheels]] number 1 radus: unknown key 'radus'; did you mean 'radius'?",
        ),
        (
            'title = "a"\n[inner]\nmas = 1.0',
            "robot.toml: [inner] mas: unknown key 'mas'; did you mean 'mass'?",
        ),
        (
            'title = "a"\n[inner]\nradius = inf',
            "robot.toml: [inner] radius: inf does not fit; expected a finite number",
        ),
        (f"title = {'[' * 5}{']' * 5}", "robot.toml: [[title]]: [[[[[]]]]] does not fit; expected text in quotes"),
    ],
)
def test_a_mistake_is_one_line_as_its_author_would_look_for_it(text: str, expected: str, tmp_path: Path) -> None:
    """File, table and key, what is wrong, and what to write instead."""
    assert mistake(text, tmp_path) == expected


def test_several_mistakes_are_several_lines(tmp_path: Path) -> None:
    """In one error that holds all of them."""
    path = tmp_path / "robot.toml"
    path.write_text("title = 1\ncount = 1.5")
    with pytest.raises(InputErrors) as caught:
        read_toml(path, Robot)
    assert len(caught.value.mistakes) == len(str(caught.value).splitlines()) == 2
    assert caught.value.place == "title"


def test_a_file_is_read_to_its_largest_size(tmp_path: Path) -> None:
    """The last byte that is read, and the first that is not."""
    path = tmp_path / "robot.toml"
    start = 'title = "a"\n#'
    path.write_text(start + "x" * (LARGEST_FILE - len(start)))
    assert read_toml(path, Robot).title == "a"
    path.write_text(start + "x" * (LARGEST_FILE - len(start) + 1))
    with pytest.raises(InputError, match=f"is larger than {LARGEST_FILE} bytes"):
        read_toml(path, Robot)


@pytest.mark.parametrize("kind", ["tables", "lists"])
def test_tables_are_read_to_their_deepest_level(kind: str, tmp_path: Path) -> None:
    """The last level that is looked at, and the first that is refused for its depth alone."""
    path = tmp_path / "robot.toml"
    for levels, words in ((DEEPEST_TABLE - 1, "does not fit"), (DEEPEST_TABLE, "nested too deeply")):
        inside = (
            "[" * levels + "]" * levels if kind == "lists" else "{ a = " * (levels - 1) + "{}" + " }" * (levels - 1)
        )
        path.write_text(f"title = {inside}")
        with pytest.raises(InputError, match=words):
            read_toml(path, Robot)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"\xff\xfe", r"cannot be read \(not UTF-8 text\)"),
        (b"title =", "not valid TOML"),
        (b"title = " + b"9" * 5000, "numbers too long"),
    ],
)
def test_what_is_no_toml_is_refused(content: bytes, words: str, tmp_path: Path) -> None:
    """In one line."""
    path = tmp_path / "robot.toml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=words) as caught:
        read_toml(path, Robot)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_and_a_folder_are_refused(tmp_path: Path) -> None:
    """With their names; a byte order mark is no mistake."""
    with pytest.raises(InputError, match=r"nowhere.toml: no such file; check the path"):
        read_toml(tmp_path / "nowhere.toml", Robot)
    with pytest.raises(InputError, match="cannot be read"):
        read_toml(tmp_path, Robot)
    (tmp_path / "mark.toml").write_bytes(b'\xef\xbb\xbftitle = "a"')
    assert read_toml(tmp_path / "mark.toml", Robot).title == "a"


@pytest.mark.parametrize(
    ("location", "data", "expected"),
    [
        ((), {}, ""),
        (("a",), {"a": 1}, "a"),
        (("a",), {"a": {}}, "[a]"),
        (("a",), {"a": []}, "[[a]]"),
        (("a", "b", "c"), {"a": {"b": {"c": 1}}}, "[a] b.c"),
        (("a", 0, "b"), {"a": [{"name": "n"}]}, "[[a]] 'n' b"),
        (("a", 0, "b"), {"a": [{"input": "i"}]}, "[[a]] 'i' b"),
        (("a", 1, "b"), {"a": [{}, {}]}, "[[a]] number 2 b"),
        (("a", 1, "b"), {"a": [{}, {"name": 3}]}, "[[a]] number 2 b"),
        (("a", 1), {"a": [1, 2]}, "a number 2"),
        (("a", 5), {"a": [1, 2]}, "a number 6"),
        (("a", "b", 1, "c", "d"), {"a": {"b": [{}, {"c": {"d": 1}}]}}, "[a] b number 2 c.d"),
        (("a", "b", 1), {"a": {"b": [{}, {}]}}, "[a] b number 2"),
        (("a", "b", 1), {"a": {"b": [1, 2]}}, "[a] b.1"),
        (("a", 0, "b", 1, "c"), {"a": [{"b": [{}, {"c": 1}]}]}, "[[a]] number 1 b number 2 c"),
        (("a", "b" * 61), {"a": {}}, "[a] 'bbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbb..."),
        (("a", "b" * 60), {"a": {}}, "[a] " + "b" * 60),
        (("a", "b\n"), {"a": {}}, r"[a] 'b\n'"),
    ],
)
def test_a_place_is_written_as_in_the_file(location: tuple, data: dict, expected: str) -> None:
    """[[wheels]] 'right' radius, [parameters] r.value."""
    assert place(location, data) == expected


class Values(Table):
    number: Number = 0.0
    numbers: Numbers = 0.0
    by_name: ByName = 0.0
    named: Named = 0.0
    estimate: Estimate = 0.0
    gain: Gain = 0.0


@pytest.mark.parametrize(
    ("key", "good", "bad"),
    [
        ("number", [1.0, 2, -1.0], [float("inf"), float("nan"), "1", [1.0], True]),
        ("numbers", [1.0, [1.0, 2.0]], [{"a": 1.0}, [[1.0]], "1", [float("nan")]]),
        ("by_name", [1.0, {"a": 1.0}], [[1.0], "1", {"a": "1"}]),
        ("named", [1.0, [1.0], {"a": 1.0}], [[[1.0]], "1", {"a": float("inf")}]),
        ("estimate", ["exact", 1.0, [1.0], {"a": 1.0}], ["exactly", [[1.0]]]),
        ("gain", [1.0, [1.0], [[1.0]], {"a": 1.0}], ["exact", [[[1.0]]]]),
    ],
)
def test_a_value_of_several_types_is_one_of_them(key: str, good: list, bad: list) -> None:
    """Finite numbers, lists, tables; nothing is converted."""
    for value in good:
        assert getattr(validate({key: value}, Values, "file"), key) == value
    for value in bad:
        with pytest.raises(InputError, match=f"file: .*{key}.*does not fit"):
            validate({key: value}, Values, "file")
    with pytest.raises(InputError, match=r"xxx\.\.\. does not fit"):
        validate({"numbers": "x" * 100}, Values, "file")


def test_the_nearest_word_is_close_or_none() -> None:
    """Case does not matter; what is far is answered by the list of all."""
    known = ["phi", "psi", "Omega"]
    assert nearest("omega", known) == "Omega"
    assert nearest("phii", known) == "phi"
    assert nearest("velocity", known) is None
    assert closest("phii", known) == "did you mean 'phi'?"
    assert closest("velocity", known) == "there is phi, psi, Omega"
    assert closest("velocity", []) == "nothing of this kind is declared"


def test_an_error_is_a_problem_and_a_remedy_also_in_another_process() -> None:
    """Its text joins them; pickled it is the same."""
    assert str(WmrError("p", "r")) == "p; r"
    assert str(WmrError("p")) == "p"
    assert str(InputError("f", "", "p")) == "f: p"
    for error in (WmrError("p", "r"), InputError("f", "at", "p", "r"), FieldError("p")):
        again = pickle.loads(pickle.dumps(error))  # noqa: S301
        assert (type(again), str(again), again.problem) == (type(error), str(error), error.problem)
    assert issubclass(FieldError, ValueError)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("plain text, in any letters: \u03b8 \u00e9 \u5f62", "plain text, in any letters: \u03b8 \u00e9 \u5f62"),
        ("two\nlines", r"two\nlines"),
        ("a\tb\r\x1b[31mred", r"a\tb\r\x1b[31mred"),
        ("\u03b8\u2028\u202e", "\u03b8" + r"\u2028\u202e"),
    ],
)
def test_an_error_is_one_line_whatever_its_words_hold(text: str, line: str) -> None:
    """Line breaks and control characters are written as Python does, all others stay as they are."""
    assert str(WmrError(text)) == line
    assert str(WmrError("p", text)) == f"p; {line}"
    assert str(InputError(text, text, "p")) == f"{line}: {line}: p"


def test_errors_inside_are_mistakes_at_their_place() -> None:
    """Once they have a place they keep it; other errors pass."""
    with pytest.raises(InputError, match=r"^file: here: p; r$"), mistakes_at("file", "here"):
        raise WmrError("p", "r")
    inner = InputError("other", "there", "p")
    with pytest.raises(InputError) as caught, mistakes_at("file", "here"):
        raise inner
    assert caught.value is inner
    with pytest.raises(KeyError), mistakes_at("file", "here"):
        raise KeyError
