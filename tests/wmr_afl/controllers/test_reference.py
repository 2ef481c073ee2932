"""References are what they say, and their derivatives are theirs."""

import pickle
from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest

from wmr_afl.controllers.reference import Reference, circle, figure_eight, line
from wmr_input import ExpressionError

KINDS = {
    "circle": circle([10.0, 25.0], 7.5, 0.05),
    "figure eight": figure_eight([2.5, 5.5], 2.0, 0.05),
    "line": line([1.0, 2.0], [0.5, -0.25]),
    "expressions": ["3*exp(-t/20)*sin(t) + t**2/100", "tanh(t - 10) + sqrt(t + 1) + abs(t - 3)"],
}


@pytest.fixture(params=KINDS)
def reference(request: pytest.FixtureRequest) -> Reference:
    return Reference(dict(zip(["y1", "y2"], KINDS[request.param], strict=True)))


def test_derivatives_equal_differences(reference: Reference) -> None:
    times, step = np.linspace(0.1, 100.0, 57), 1e-4
    (behind, *_), (_, velocity, acceleration), (ahead, *_) = (reference.over(times + d) for d in (-step, 0.0, step))
    middle = reference.over(times)[0]
    np.testing.assert_allclose(velocity, (ahead - behind) / (2 * step), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(acceleration, (ahead - 2 * middle + behind) / step**2, rtol=1e-4, atol=1e-5)


def test_one_time_many_times_and_symbols_agree(reference: Reference) -> None:
    times = np.array([0.0, 3.5, 77.0])
    over = reference.over(times)
    t = ca.SX.sym("t")
    point = reference.at(t)
    traced = ca.Function("f", [t], [point.position, point.velocity, point.acceleration])
    for row, time in enumerate(times):
        one = reference.at(time)
        np.testing.assert_array_equal(reference.row(time), np.ravel([one.position, one.velocity, one.acceleration]))
        for part, many, symbolic in zip(
            (one.position, one.velocity, one.acceleration), over, traced(time), strict=True
        ):
            np.testing.assert_array_equal(part, many[row])
            np.testing.assert_array_equal(symbolic.full()[:, 0], many[row])


def test_a_row_is_that_of_its_time_in_any_thread() -> None:
    """Four threads ask one reference, each for other times; a copy has numbers of its own."""
    reference = Reference({"y1": "t", "y2": "2 + 3*t"})
    copy = pickle.loads(pickle.dumps(reference))  # noqa: S301, our own

    def ask(begin: int) -> bool:
        times = [begin + 1e-3 * n for n in range(5000)]
        return all(one.row(t) == [t, 2 + 3 * t, 1.0, 3.0, 0.0, 0.0] for t in times for one in (reference, copy))

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(ask, range(4)))


def test_a_reference_names_its_outputs_in_its_order() -> None:
    assert Reference({"b": "t", "a": "2"}).outputs == ("b", "a")
    assert Reference({"b": "t", "a": "2"}).ordered(["a", "b"]).outputs == ("a", "b")
    assert Reference({"b": "t"}).duration is None


def test_the_papers_circle_and_eight() -> None:
    """(92), (94)"""
    t = np.linspace(0.0, 140.0, 50)
    position = Reference(dict(zip("ab", KINDS["circle"], strict=True))).over(t)[0]
    np.testing.assert_allclose(position, np.stack([10 + 7.5 * np.cos(0.05 * t), 25 + 7.5 * np.sin(0.05 * t)], axis=1))
    position = Reference(dict(zip("ab", KINDS["figure eight"], strict=True))).over(t)[0]
    np.testing.assert_allclose(position, np.stack([2.5 + 2 * np.sin(0.1 * t), 5.5 + 2 * np.sin(0.05 * t)], axis=1))


@pytest.mark.parametrize("text", ["x + t", "t +", "__import__('os')", "t**1000"])
def test_what_is_not_an_expression_of_time_is_refused(text: str) -> None:
    with pytest.raises(ExpressionError):
        Reference({"y1": text})
