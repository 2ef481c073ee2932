"""What is handed out can be copied and sent to another process, errors of every kind included."""

import copy
import inspect
import pickle
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import numpy as np
import pytest

import wmr_afl
from derive.algebra import units
from wmr_afl import errors as runtime_errors
from wmr_afl.experiments.load import load_experiment
from wmr_input import errors as input_errors
from wmr_input import expression

WAYS: list[Callable[[Any], Any]] = [copy.copy, copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))]  # noqa: S301
KINDS = sorted(
    {
        kind
        for module in (runtime_errors, input_errors, expression, units)
        for _, kind in inspect.getmembers(module, inspect.isclass)
        if issubclass(kind, wmr_afl.WmrError)
    },
    key=lambda kind: kind.__name__,
)


def an_error(kind: type[wmr_afl.WmrError]) -> wmr_afl.WmrError:
    """An error of this kind with all that its constructor asks for."""
    texts: dict[str, Any] = {
        "known": ["one", "other"],
        "mistakes": [wmr_afl.InputError("file", "key", "is wrong", "mend it")],
    }
    names = inspect.signature(kind).parameters
    return kind(*(texts.get(name, name) for name in names))


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_an_error_says_the_same_after_a_copy(kind: type[wmr_afl.WmrError], way: Callable[[Any], Any]) -> None:
    error = an_error(kind)
    other = way(error)
    assert type(other) is kind
    assert (str(other), other.problem, other.remedy) == (str(error), error.problem, error.remedy)


def fail(name: str) -> None:
    wmr_afl.load_model(name)


def test_an_error_of_another_process_arrives() -> None:
    with (
        ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool,
        pytest.raises(wmr_afl.UnknownNameError, match="unknown model"),
    ):
        pool.submit(fail, "no_such_robot").result(timeout=60)


@pytest.mark.parametrize("way", WAYS)
def test_runs_models_and_loops_can_be_copied(way: Callable[[Any], Any]) -> None:
    run = wmr_afl.run("track_mecanum", controllers="exact")["exact"]
    other = way(run)
    np.testing.assert_array_equal(other.state, run.state)
    np.testing.assert_array_equal(other.output, run.output)
    model = way(run.model)
    p = model.parameters()
    np.testing.assert_array_equal(model.base_parameters(p), run.model.base_parameters(p))
    loop = load_experiment("study_2").loops["robust AFL"]
    np.testing.assert_array_equal(way(loop.reference).at(1.0).position, loop.reference.at(1.0).position)
    for name, value in way(loop).values.items():
        np.testing.assert_array_equal(value, loop.values[name])
    assert way(load_experiment("study_2").experiment) == load_experiment("study_2").experiment
