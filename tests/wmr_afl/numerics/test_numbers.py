"""Arrays, small systems, formulas, parts and rules: what stands below every robot."""

from itertools import combinations
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from wmr_afl.errors import ShapeError, UnknownNameError, WmrError
from wmr_afl.numerics.arrays import LIBRARIES, NUMPY, Arrays, dot, norm
from wmr_afl.numerics.complementarity import stopping_forces
from wmr_afl.numerics.formulas import TimeFunction, numpy_value
from wmr_afl.numerics.linear_algebra import SINGULAR, entries, least_norm, regularity, solve, sum_of_squares
from wmr_afl.numerics.parts import Part, Parts, by_part, disjoint, prefixed
from wmr_afl.numerics.rules import Numbers
from wmr_afl.numerics.vectors import by_name, per_entry
from wmr_input import ExpressionError


def in_library(arrays: Arrays, array: np.ndarray):  # type: ignore[no-untyped-def]
    return array if arrays is NUMPY else ca.DM(array)


def numbers_of(value) -> np.ndarray:  # type: ignore[no-untyped-def]
    """A value of either library, as NumPy, vectors (n,)."""
    full = value.full() if isinstance(value, ca.DM) else np.asarray(value)
    return full[:, 0] if full.ndim == 2 and full.shape[1] == 1 else full


A, B = np.array([-1.5, 0.0, 2.25, 0.5]), np.array([-2.0, 0.25, 2.25, 1.0])
OPERATIONS = {
    "sin": (np.sin, (A,)),
    "cos": (np.cos, (A,)),
    "exp": (np.exp, (A,)),
    "sqrt": (np.sqrt, (A**2,)),
    "absolute": (np.abs, (A,)),
    "sign": (np.sign, (A,)),
    "maximum": (np.maximum, (A, B)),
    "minimum": (np.minimum, (A, B)),
}


@pytest.mark.parametrize("library", LIBRARIES)
@pytest.mark.parametrize("operation", OPERATIONS)
def test_an_operation_means_in_both_libraries_what_numpy_means(operation: str, library: str) -> None:
    """A law is written once: each operation has one meaning."""
    arrays, (expected, given) = LIBRARIES[library], OPERATIONS[operation]
    found = getattr(arrays, operation)(*(in_library(arrays, array) for array in given))
    np.testing.assert_allclose(numbers_of(found), expected(*given), rtol=1e-15)


@pytest.mark.parametrize("library", LIBRARIES)
def test_vectors_are_built_joined_chosen_and_measured_alike(library: str) -> None:
    """The rest of the operations, of which some are no function of one name in both libraries."""
    arrays = LIBRARIES[library]
    a, b = (in_library(arrays, array) for array in (A, B))
    np.testing.assert_array_equal(numbers_of(arrays.vector([1.0, a[0], 2.0])), [1.0, A[0], 2.0])
    np.testing.assert_array_equal(numbers_of(arrays.join([a, b[:2]])), [*A, *B[:2]])
    np.testing.assert_array_equal(numbers_of(arrays.where(a[0] < b[0], a, b)), B)
    np.testing.assert_array_equal(numbers_of(arrays.where(a[0] > b[0], a, b)), A)
    np.testing.assert_allclose(float(dot(a, b)), A @ B, rtol=1e-15)
    np.testing.assert_allclose(float(norm(a, arrays)), np.sqrt(A @ A), rtol=1e-15)


@pytest.mark.parametrize("library", LIBRARIES)
def test_small_systems_are_solved_alike(library: str) -> None:
    """By Cramer's rule and by the weighted right inverse, in both libraries."""
    arrays, random = LIBRARIES[library], np.random.default_rng(0)
    for size in (1, 2, 3):
        matrix, right = random.normal(size=(size, size)), random.normal(size=size)
        found = solve(in_library(arrays, matrix), in_library(arrays, right), arrays)
        np.testing.assert_allclose(numbers_of(found), np.linalg.solve(matrix, right), rtol=1e-10)
    matrix, right, weights = random.normal(size=(2, 4)), random.normal(size=2), np.array([1.0, 2.0, 3.0, 4.0])
    found = least_norm(*(in_library(arrays, one) for one in (matrix, right, weights)), arrays)
    inverse = np.diag(1.0 / weights)
    expected = inverse @ matrix.T @ np.linalg.solve(matrix @ inverse @ matrix.T, right)
    np.testing.assert_allclose(numbers_of(found), expected, rtol=1e-10)


def test_regularity_is_the_squared_volume_less_its_smallest_meaningful_value() -> None:
    """Of the largest minor, with a threshold of 1e-9 of the rows' lengths."""
    random = np.random.default_rng(1)
    for shape in ((1, 1), (2, 2), (3, 3), (2, 3), (1, 4)):
        matrix = random.normal(size=shape)
        chosen = [matrix] if shape[0] == shape[1] else []
        if not chosen:
            chosen = [matrix[:, list(columns)] for columns in combinations(range(shape[1]), shape[0])]
        volume = max(np.linalg.det(one) ** 2 for one in chosen)
        found = regularity(matrix, NUMPY)
        np.testing.assert_allclose(found, volume - 1e-18 * np.prod(np.sum(matrix**2, axis=1)), rtol=1e-12)
    rows = np.array([[1.0, 0.0], [1.0, 1.0001 * SINGULAR]])
    assert regularity(rows, NUMPY) > 0.0
    assert regularity(rows * [[1.0, 0.9998]], NUMPY) < 0.0


def test_entries_are_by_row_and_the_norm_is_frobenius() -> None:
    """For matrices that are not square, too."""
    matrix = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    assert entries(matrix) == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    assert sum_of_squares(matrix) == 91.0


TIME = {  # what each function of time is, before, at and after its special point
    "sin(t)": np.sin,
    "cos(t)": np.cos,
    "tan(t)": np.tan,
    "exp(t)": np.exp,
    "sqrt(t + 2)": lambda t: np.sqrt(t + 2.0),
    "tanh(t)": np.tanh,
    "asin(t/2)": lambda t: np.arcsin(t / 2.0),
    "acos(t/2)": lambda t: np.arccos(t / 2.0),
    "atan(t)": np.arctan,
    "atan2(t, 2)": lambda t: np.arctan2(t, 2.0),
    "atan2(2, t)": lambda t: np.arctan2(2.0, t),
    "abs(t)": np.abs,
    "sign(t)": np.sign,
    "step(t)": lambda t: float(t >= 0.0),
    "pi*t": lambda t: np.pi * t,
    "t/3": lambda t: t / 3.0,
    "(t + 2)**(3/2)": lambda t: (t + 2.0) ** 1.5,
    "(t + 2)**-2": lambda t: (t + 2.0) ** -2,
}


@pytest.mark.parametrize("text", TIME)
@pytest.mark.parametrize("t", [-1.5, -1e-300, 0.0, 1e-300, 0.7])
def test_a_function_of_time_means_what_its_name_says(text: str, t: float) -> None:
    """step(0) = 1, sign(0) = 0; also where it is traced."""
    symbol = ca.SX.sym("t")
    traced = ca.Function("f", [symbol], TimeFunction([text])(symbol))
    for value in (TimeFunction([text])(t)[0][0], float(traced(t))):
        np.testing.assert_allclose(value, TIME[text](t), rtol=1e-15)


def test_derivatives_of_functions_of_time_are_as_many_as_are_asked_for() -> None:
    """Value, rate and so on, a row for each expression."""
    parts = TimeFunction(["t**3", "2"], order=2)(2.0)
    np.testing.assert_array_equal(parts, [[8.0, 2.0], [12.0, 0.0], [12.0, 0.0]])
    assert len(TimeFunction(["t"])(0.0)) == 1


@pytest.mark.parametrize("name", ["sin", "cos", "tan", "exp", "sqrt", "tanh", "abs", "sign"])
def test_formulas_of_a_model_are_numpys(name: str) -> None:
    """Names may be arrays, and pi is known."""
    x = np.array([0.0, 0.5, 1.25])
    found = numpy_value(f"2*{name}(x) + pi/a", {"x": x, "a": 4.0})
    for inverse, angle in (("asin(x/2)", np.arcsin(x / 2)), ("acos(x/2)", np.arccos(x / 2)), ("atan(x)", np.arctan(x))):
        np.testing.assert_allclose(numpy_value(inverse, {"x": x}), angle, rtol=1e-15)
    np.testing.assert_allclose(numpy_value("atan2(x, -1)", {"x": x}), np.arctan2(x, -1.0), rtol=1e-15)
    np.testing.assert_allclose(found, 2.0 * getattr(np, name)(x) + np.pi / 4.0, rtol=1e-15)
    with pytest.raises(ExpressionError):
        numpy_value("y", {"x": x})


class Numbered(Part):
    """A part with a number and a state."""

    def __init__(self, name: str, number: float) -> None:
        self.name, self.number = name, number

    @property
    def values(self) -> dict[str, np.ndarray]:
        return {"gain": np.array([self.number])}

    @property
    def states(self) -> dict[str, np.ndarray]:
        return {"z": np.array([-self.number])}


def test_parts_keep_their_order_and_are_numbered() -> None:
    """friction, friction_2, friction_3; None is no part."""
    parts = Parts([Numbered("a", 1.0), None, Numbered("b", 2.0), Numbered("a", 3.0), Numbered("a", 4.0)])
    assert [part.number for part in parts] == [1.0, 2.0, 3.0, 4.0]
    assert {name: float(value[0]) for name, value in parts.values.items()} == {
        "a.gain": 1.0, "b.gain": 2.0, "a_2.gain": 3.0, "a_3.gain": 4.0,
    }  # fmt: skip
    assert list(parts.states) == ["a.z", "b.z", "a_2.z", "a_3.z"]
    k, z = by_part(parts.values), by_part(parts.states)
    assert [float(own.gain[0]) for _, own in parts.with_values(k)] == [1.0, 2.0, 3.0, 4.0]
    found = [(key, float(state.z[0]), float(own.gain[0])) for key, _, state, own in parts.with_states(z, k)]
    assert found == [("a", -1.0, 1.0), ("b", -2.0, 2.0), ("a_2", -3.0, 3.0), ("a_3", -4.0, 4.0)]
    assert vars(next(iter(parts.with_values(SimpleNamespace())))[1]) == {}
    assert (Part().values, Part().states) == ({}, {})


def test_names_with_a_part_stand_under_it() -> None:
    """k.p, k.friction.viscous; two numbers of a part meet under its name."""
    k = by_part({"p": 1, "friction.viscous": 2, "friction.coulomb": 3, "limits.volts": 4})
    assert (k.p, k.friction.viscous, k.friction.coulomb, k.limits.volts) == (1, 2, 3, 4)
    assert prefixed("friction", {"z": 1}) == {"friction.z": 1}


def test_names_that_are_shared_are_refused() -> None:
    """One would silently replace the other."""
    assert disjoint({"a": 1}, {"b": 2}) == {"a": 1, "b": 2}
    with pytest.raises(WmrError, match="share the name 'b'"):
        disjoint({"a": 1, "b": 2}, {"c": 3}, {"b": 4})


def test_a_number_is_what_is_given_else_what_its_rule_gives_else_what_the_loop_holds() -> None:
    """And then it is scaled, and what follows from it follows from the scaled one."""
    calls = []

    def twice(n: Numbers) -> np.ndarray:
        calls.append(1)
        return 2.0 * n["a"]

    rules, loop = {"b": twice, "a": lambda n: 0.0}, {"a": np.ones(2), "b": np.ones(2), "c": np.full(2, 7.0)}
    numbers = Numbers(rules, {"a": np.array([[1.0, 2.0], [3.0, 4.0]])}, loop, {"a": np.array([10.0, 100.0])})
    np.testing.assert_array_equal(numbers["a"], [[10.0, 20.0], [300.0, 400.0]])
    np.testing.assert_array_equal(numbers["b"], [[20.0, 40.0], [600.0, 800.0]])
    np.testing.assert_array_equal(numbers["b"], numbers["b"])
    np.testing.assert_array_equal(numbers["c"], [7.0, 7.0])
    assert len(calls) == 1
    scaled = Numbers({}, {}, {"Gamma": np.eye(2)}, {"Gamma": np.array([1.0, 2.0, 3.0])})
    assert scaled["Gamma"].shape == (3, 2, 2)
    np.testing.assert_array_equal(scaled["Gamma"][2], 3.0 * np.eye(2))


def test_numbers_by_name_are_in_the_order_of_the_names() -> None:
    """One for all, a list in order, or a table."""
    names = ["a", "b", "c"]
    assert by_name("thing", 2.0, names).tolist() == [2.0, 2.0, 2.0]
    assert by_name("thing", [1.0, 2.0, 3.0], names).tolist() == [1.0, 2.0, 3.0]
    assert by_name("thing", {"c": 3.0, "a": 1.0, "b": 2.0}, names).tolist() == [1.0, 2.0, 3.0]
    assert by_name("thing", {"b": 2.0}, names, missing=-1.0).tolist() == [-1.0, 2.0, -1.0]
    with pytest.raises(UnknownNameError, match="unknown thing 'd'"):
        by_name("thing", {"d": 1.0}, names)
    with pytest.raises(WmrError, match="thing 'b' is missing"):
        by_name("thing", {"a": 1.0, "c": 1.0}, names)
    for wrong in ([1.0, 2.0], [1.0, 2.0, 3.0, 4.0], [[1.0, 2.0, 3.0]]):
        with pytest.raises(WmrError, match="numbers for 3"):
            by_name("thing", wrong, names)


def test_numbers_for_each_entry_are_finite_and_fit() -> None:
    """One for all or one each, and a copy of its own."""
    given = np.array([1.0, 2.0])
    found = per_entry("b1", given, 2)
    found[0] = 5.0
    assert given[0] == 1.0
    assert per_entry("b1", 3.0, 2).tolist() == [3.0, 3.0]
    for wrong in ([1.0], [1.0, np.nan], np.inf, [1.0, 2.0, 3.0]):
        with pytest.raises(ShapeError, match="b1"):
            per_entry("b1", wrong, 2)


def test_what_is_at_rest_takes_no_force() -> None:
    """Also where two forces could hold each other without an effect."""
    free = [None, None]
    assert stopping_forces([0.0, 0.0], [[1.0, -1.0], [-1.0, 1.0]], free, free, NUMPY) == [0.0, 0.0]


@pytest.mark.parametrize("library", LIBRARIES)
@pytest.mark.parametrize("count", [1, 2, 3])
def test_forces_that_act_on_each_other_stop_what_they_oppose(count: int, library: str) -> None:
    """No rate is left between the bounds, and at a bound only one that the force opposes in vain; None is no bound."""
    random, seen = np.random.default_rng(count), set()
    for _ in range(20):
        root = np.eye(count) + 0.3 * random.normal(size=(count, count))
        effects, rates = root @ root.T, random.normal(size=count)
        most, least = random.uniform(0.1, 1.0, count), [None, *random.uniform(-1.0, -0.1, count - 1)]
        found = stopping_forces(list(rates), effects.tolist(), least, list(most), LIBRARIES[library])
        force = np.array([float(one) for one in found])
        left = rates - effects @ force
        at_most, at_least = force == most, np.array([force[i] == least[i] for i in range(count)])
        assert np.all(np.abs(left[~at_most & ~at_least]) < 1e-6)
        assert np.all(left[at_most] > -1e-6)
        assert np.all(left[at_least] < 1e-6)
        assert np.all(force <= most)
        seen |= {*at_most.tolist(), *at_least.tolist()}
    assert seen == {True, False}


def test_a_part_takes_what_its_constructor_gives_it_and_nothing_later() -> None:
    """Not even the same once more: what was traced from it would not notice."""

    class Base(Part):
        def __init__(self) -> None:
            self.first = 1

    class Derived(Base):
        def __init__(self) -> None:
            super().__init__()
            self.second = 2

    for one in (Base(), Derived()):
        for name in ("first", "second"):
            with pytest.raises(AttributeError, match=f"a {type(one).__name__} is fixed once it is built"):
                setattr(one, name, 1)
    assert vars(Derived()) == {"first": 1, "second": 2, "_is_built": True}
