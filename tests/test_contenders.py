"""Every contender of the benchmarks runs the same closed loop as this project."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.contenders import (
    ANY_LOOP,
    LITERAL,
    MANY_ROBOTS,
    ONE_ROBOT,
    OWN,
    OWN_CASADI,
    OWN_NUMPY,
    OWN_THREADS,
    Contender,
)
from benchmarks.contenders.agreement import TOLERANCE, deviation
from benchmarks.contenders.work import Work, lasting
from wmr_afl.experiments.experiment import read_experiment
from wmr_afl.simulation.kernels.c_compiler import compiler

SAMPLES = 500
COMPILED = {"literal", "best", "casadi_generated"}


def work(folder: Path, experiment: str = "study_1", controller: str = "AFL") -> Work:
    sample_time = read_experiment(experiment)[0].simulation.sample_time
    return Work(lasting(experiment, (SAMPLES - 1) * sample_time, folder), controller)


def named(contenders: tuple[Contender, ...]) -> list[object]:
    return [pytest.param(contender, id=contender.name.replace(" ", "-")) for contender in contenders]


def prepared(contender: Contender, kind: str, task: Work) -> object:
    if contender.needs:
        pytest.importorskip(contender.needs)
    if compiler() is None and (contender.module in COMPILED or contender in (OWN, OWN_THREADS)):
        pytest.skip("no C compiler")
    return contender.prepared(kind, task)()


@pytest.mark.parametrize("contender", named(ONE_ROBOT))
def test_a_logged_run_of_study_1_is_the_same(contender: Contender, tmp_path: Path) -> None:
    task = work(tmp_path)
    expected = OWN_NUMPY.prepared("one", task)()
    assert len(expected.time) == SAMPLES
    assert deviation(task, prepared(contender, "one", task), expected) <= TOLERANCE


@pytest.mark.parametrize("contender", named(MANY_ROBOTS))
def test_robots_that_differ_end_the_same_with_the_same_errors(contender: Contender, tmp_path: Path) -> None:
    random, one = np.random.default_rng(0), work(tmp_path)
    start = {"x": random.uniform(14.5, 15.5, 11)}
    parameters = {"m_C": random.uniform(30.0, 42.0, 11), "L": np.linspace(0.1, 0.2, 11)}
    task = Work(one.file, one.controller, start, parameters)
    expected = OWN_CASADI.prepared("many", task)()
    assert deviation(task, prepared(contender, "many", task), expected) <= TOLERANCE


@pytest.mark.parametrize("contender", named(ANY_LOOP))
@pytest.mark.parametrize("kind", ["one", "many"])
def test_other_robots_run_the_same(contender: Contender, kind: str, tmp_path: Path) -> None:
    one = work(tmp_path, "track_mecanum")
    task = one if kind == "one" else Work(one.file, one.controller, {"x": np.linspace(0.0, 0.2, 3)})
    expected = (OWN_NUMPY if kind == "one" else OWN_CASADI).prepared(kind, task)()
    assert deviation(task, prepared(contender, kind, task), expected) <= TOLERANCE


def test_a_deviation_is_seen(tmp_path: Path) -> None:
    task = work(tmp_path)
    run = OWN_NUMPY.prepared("one", task)()
    expected = np.hstack([run.state, run.input, run.error, run.estimate])
    assert deviation(task, run, expected) == 0.0
    for column, size in ((0, 30.0), (8, 3.0), (14, 1.0)):
        other = expected.copy()
        other[-1, column] += 1e-8 * size
        assert TOLERANCE < deviation(task, other, expected) < 1e-6


@pytest.mark.skipif(compiler() is None, reason="no C compiler")
def test_a_run_that_is_lost_is_told(tmp_path: Path) -> None:
    one = work(tmp_path)
    unbounded = one.file.read_text().replace("lower = 0.1", "lower = 1e-14")
    one.file.write_text(unbounded)
    with pytest.raises(ArithmeticError, match="lost"):
        LITERAL.prepared("one", one)()
