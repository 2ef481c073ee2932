"""Machine code gives the same numbers as the other backends, and never a number instead of NaN."""

import ctypes
import math
import re
import subprocess
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path

import casadi as ca
import mpmath
import numpy as np
import pytest

import wmr_afl
from tests.conftest import EXPERIMENTS, ROOT
from wmr_afl import (
    BackendWarning,
    CompilerError,
    ShapeError,
    SimulationError,
    SimulationWarning,
    UnknownNameError,
    WmrError,
)
from wmr_afl.experiments import load as loading
from wmr_afl.experiments.assembly import assemble
from wmr_afl.experiments.experiment import list_experiments, read_experiment
from wmr_afl.simulation.batch import watched_signals
from wmr_afl.simulation.closed_loop import trace
from wmr_afl.simulation.kernels import c_compiler as build
from wmr_afl.simulation.kernels import compiled as kernel_module
from wmr_afl.simulation.kernels.block import Watched
from wmr_afl.simulation.kernels.c_printer import Argument, Depends, print_step
from wmr_afl.simulation.kernels.compiled import Kernel, kernel_text
from wmr_afl.simulation.simulate import simulate

pytestmark = pytest.mark.skipif(build.compiler() is None, reason="no C compiler")


def kernel_of(function, lanes: int = 1) -> Kernel:
    """A kernel whose next state is a function of the state; its one signal is that state."""
    z, t, sample, k = (ca.SX.sym(name) for name in ("z", "t", "sample", "k"))
    step = ca.Function("step", [z, t, sample, k], [function(z, t), ca.if_else(True, 1.0, z)])
    return Kernel(step, Watched(regularity=0), lanes)


def once(kernel: Kernel, values: np.ndarray) -> np.ndarray:
    """One step of many states, block after block."""
    padded = np.concatenate([values, np.zeros(-len(values) % kernel.lanes)]).reshape(-1, kernel.lanes)
    results = []
    for row in padded:
        block = kernel.start(row[None, :])
        kernel.advance(block, np.zeros(1), None, kernel.prepare(np.zeros((1, kernel.lanes))))
        results.append(block.state[0])
    return np.concatenate(results)[: len(values)]


@pytest.mark.parametrize(("name", "function", "exact"), [("sin", ca.sin, mpmath.sin), ("cos", ca.cos, mpmath.cos)])
def test_sine_and_cosine_are_accurate_to_two_units_in_the_last_place(name: str, function, exact) -> None:
    random = np.random.default_rng(0)
    near = np.array([k * math.pi / 2 + d for k in range(-50, 51) for d in (0.0, 1e-9, -1e-5)])
    angles = np.concatenate([
        random.uniform(-1, 1, 400), random.uniform(-10, 10, 400), random.uniform(-1e5, 1e5, 400), near,
        10.0 ** random.uniform(5, 15, 200), 10.0 ** random.uniform(15, 300, 50),
        [0.0, -0.0, 5e-324, 1e-8, 99999.9, 100000.1],
    ])  # fmt: skip
    found = once(kernel_of(lambda z, t: function(z), 32), angles)
    with mpmath.workdps(360):
        for angle, value in zip(angles, found, strict=True):
            truth = exact(mpmath.mpf(float(angle)))
            unit = math.ulp(max(abs(float(truth)), 1e-300))
            assert abs(mpmath.mpf(float(value)) - truth) <= 2.0 * unit, (name, angle)


def test_what_is_not_a_number_stays_not_a_number() -> None:
    odd = np.array([np.nan, np.inf, -np.inf])
    for function in (
        ca.sin,
        ca.cos,
        lambda z: ca.fmin(z, 1.0),
        ca.sign,
        lambda z: ca.fmax(1.0, z),
        lambda z: ca.fmin(2.0, z),
    ):
        assert np.isnan(once(kernel_of(lambda z, t, f=function: f(z)), odd))[0]


@pytest.mark.parametrize("study", [name for name in list_experiments() if name != "study_2_high_gain"])
def test_compiled_and_casadi_agree(study: str) -> None:
    """Every robot and every controller; with the robust term until it chatters."""
    for name, loop in assemble(*read_experiment(study)).items():
        first, second = (simulate(loop, 5.0, name, backend) for backend in ("casadi", "compiled"))
        for signal in ("state", "input", "command", "error", "estimate"):
            a, b = getattr(first, signal), getattr(second, signal)
            assert np.max(np.abs(a - b), initial=0.0) <= 1e-9 * max(1.0, np.max(np.abs(a), initial=0.0)), signal


def test_study_1_agrees_over_all_steps_and_to_the_bit_with_itself() -> None:
    first, second = (wmr_afl.run("study_1", backend="compiled") for _ in range(2))
    for name, other in wmr_afl.run("study_1", backend="casadi").items():
        assert np.max(np.abs(first[name].state - other.state)) <= 1e-9 * np.max(np.abs(other.state))
        assert first[name].state.tobytes() == second[name].state.tobytes()


def test_a_failure_is_reported_as_by_the_other_backends(tmp_path: Path) -> None:
    text = (EXPERIMENTS / "study_1.toml").read_text().replace("lower = 0.1", "lower = 1e-14")
    (tmp_path / "wild.toml").write_text(text)
    failures = []
    for backend in ("casadi", "compiled"):
        with pytest.warns(SimulationWarning, match="singular"):
            failures.append(wmr_afl.run(tmp_path / "wild.toml", backend, "AFL")["AFL"].failure)
    assert failures[0].time == failures[1].time


def test_the_text_is_the_same_every_time_and_in_every_process() -> None:
    here = "tests.wmr_afl.simulation.kernels.test_compiled"
    script = f"import sys; from {here} import text_of_study_1\nsys.stdout.write(text_of_study_1())"
    texts = {
        subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True).stdout
        for _ in range(2)
    }
    assert texts == {text_of_study_1()}


def text_of_study_1() -> str:
    loop = assemble(*read_experiment("study_1"))["AFL"]
    return kernel_text(trace(loop), watched_signals(loop), 8, False)[0]


def test_a_library_is_built_once_and_found_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WMR_AFL_CACHE", str(tmp_path))
    text = "double f(void) { return 4.0; }"
    for _ in range(2):
        library = build.library(text)
        library.f.restype = ctypes.c_double
        assert library.f() == 4.0
    assert [path.suffix for path in (tmp_path / "wmr-afl").iterdir()] == [".so"]
    with pytest.raises(WmrError, match="failed on the closed loop"):
        build.library("this is no C")
    assert len(list((tmp_path / "wmr-afl").iterdir())) == 1


def test_several_processes_may_build_the_same(tmp_path: Path) -> None:
    script = "from wmr_afl.simulation.kernels import c_compiler as build; build.library('int g(void) { return 1; }')"
    environment = {"WMR_AFL_CACHE": str(tmp_path), "PATH": "/usr/local/bin:/usr/bin:/bin", "PYTHONPATH": str(ROOT)}
    running = [subprocess.Popen([sys.executable, "-c", script], cwd=ROOT, env=environment) for _ in range(4)]
    assert [process.wait(60) for process in running] == [0] * 4
    assert len(list((tmp_path / "wmr-afl").glob("*.so"))) == 1


@pytest.fixture
def no_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache of this test's own, and nothing remembered in this process."""
    monkeypatch.setenv("WMR_AFL_CACHE", str(tmp_path))
    forget()
    yield tmp_path / "wmr-afl"
    monkeypatch.undo()
    forget()


def forget() -> None:
    """What this process remembers of compilers, libraries and loops."""
    for remembered in (build._identity, build.compiler, kernel_module._functions, loading._assembled):
        if hasattr(remembered, "cache_clear"):  # also if a test has put something else in its place
            remembered.cache_clear()


@contextmanager
def one_line(words: str) -> Iterator[None]:
    """One warning of one line that says so."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield
    (warning,) = caught
    assert issubclass(warning.category, BackendWarning)
    assert re.search(words, str(warning.message))
    assert "\n" not in str(warning.message)


START = {"x": [15.0, 15.1]}


def test_without_a_compiler_one_line_says_so(no_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from wmr_afl.simulation import steppers as stepping

    compiled = wmr_afl.run_batch("study_1", start=START)
    monkeypatch.setattr(build, "compiler", lambda: None)
    forget()
    with one_line("no C compiler was found; running on CasADi's virtual machine"):
        interpreted = wmr_afl.run_batch("study_1", start=START)
    np.testing.assert_allclose(interpreted.rms, compiled.rms, rtol=1e-9)
    monkeypatch.setattr(stepping, "WORTH_BUILDING", 1)
    with one_line("no C compiler was found"):
        assert wmr_afl.run("study_1", controllers="AFL")["AFL"].failure is None
    with pytest.raises(CompilerError, match="no C compiler was found; install one, or run with backend casadi"):
        wmr_afl.run("study_1", backend="compiled")


def test_a_compiler_that_fails_is_reported_in_one_line(no_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    failing = no_cache.parent / "bad_cc"
    failing.write_text("#!/bin/sh\necho 'cc: fatal error: out of order' >&2\nexit 1\n")
    failing.chmod(0o755)
    monkeypatch.setenv("CC", str(failing))
    with one_line("bad_cc failed on the closed loop .*out of order.*; running on CasADi's virtual machine"):
        assert not wmr_afl.run_batch("study_1", start=START).failed.any()
    with pytest.raises(CompilerError, match="out of order"):
        wmr_afl.run("study_1", backend="compiled")


def test_a_cache_that_cannot_be_written_is_reported_in_one_line(no_cache: Path) -> None:
    no_cache.write_text("a file where the folder should be")
    with one_line("wmr-afl: cannot be written .*; running on CasADi's virtual machine"):
        assert not wmr_afl.run_batch("study_1", start=START).failed.any()
    with pytest.raises(CompilerError, match="set WMR_AFL_CACHE"):
        wmr_afl.run("study_1", backend="compiled")


@pytest.mark.parametrize(
    "damage", [lambda b: b[: len(b) // 2], lambda b: b"", lambda b: b[:5000] + b"\xff" * 64 + b[5064:]]
)
def test_a_damaged_library_is_built_again(no_cache: Path, damage) -> None:
    first = wmr_afl.run_batch("study_1", start=START)
    (library,) = no_cache.glob("*.so")
    content = damage(library.read_bytes())
    library.unlink()  # this process still has the old one in memory
    library.write_bytes(content)
    forget()
    with one_line("was damaged; it is built again"):
        second = wmr_afl.run_batch("study_1", start=START)
    assert first.final_state.tobytes() == second.final_state.tobytes()
    assert len(list(no_cache.iterdir())) == 1


@pytest.mark.skipif(find_spec("ziglang") is None, reason="ziglang is not installed")
def test_zig_builds_the_same_if_there_is_no_system_compiler(no_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    by_cc = wmr_afl.run_batch("study_1", start=START)
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    forget()
    assert build.compiler()[1] == "cc"
    np.testing.assert_allclose(wmr_afl.run_batch("study_1", start=START, backend="compiled").rms, by_cc.rms, rtol=1e-9)


def test_constants_are_printed_to_the_bit() -> None:
    x = ca.SX.sym("x")
    program = print_step(ca.Function("f", [x], [x * 0.1 - 1e-17]), [Argument("x", Depends.BOTH)])
    literals = re.findall(r"-?0x[^ ;)]+", " ".join([*program.both, *program.results[0]]))
    assert {Fraction(float.fromhex(text)) for text in literals} == {Fraction(0.1), Fraction(1e-17)}


def test_what_does_not_change_is_computed_once() -> None:
    """Per robot, per step, and only the rest for both; divisions by what stays become products."""
    z, t, k = ca.SX.sym("z"), ca.SX.sym("t"), ca.SX.sym("k")
    arguments = [Argument("z", Depends.BOTH), Argument("t", Depends.TIME), Argument("k", Depends.ROBOT)]
    program = print_step(
        ca.Function("f", [z, t, k], [z / ca.exp(k) + ca.tan(t), ca.sin(z) / z + ca.cos(z) / z]), arguments
    )
    count = {name: " ".join(getattr(program, name)) for name in ("robot", "time", "both")}
    assert ("exp" in count["robot"], "tan" in count["time"]) == (True, True)
    assert not re.search("exp|tan", count["both"])
    assert count["both"].count("/") == 1  # 1/z, for both quotients
    assert count["both"].count("sincos_of") == 1


BATCH = {"m_C": [30.0, 36.0, 42.0], "K1": [7.0, 7.2, 7.4]}


def test_a_batch_gives_what_single_runs_give(tmp_path: Path) -> None:
    batch = wmr_afl.run_batch("study_1", parameters=BATCH, start={"x": [15.0, 15.5, 14.5]}, since=50.0)
    text = (EXPERIMENTS / "study_1.toml").read_text()
    for i in range(3):
        changed = text.replace("[start]", f"[parameters]\nm_C = {BATCH['m_C'][i]}\nK1 = {BATCH['K1'][i]}\n[start]")
        (tmp_path / "one.toml").write_text(changed.replace("x = 15.0", f"x = {[15.0, 15.5, 14.5][i]}"))
        one = wmr_afl.run(tmp_path / "one.toml", controllers="AFL")["AFL"]
        np.testing.assert_allclose(batch.rms[i], one.rms(since=50.0), rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(batch.largest_input[i], np.abs(one.input[2500:]).max(axis=0), rtol=1e-9)
    assert not batch.failed.any()


def test_exact_estimates_follow_each_robot_of_a_batch() -> None:
    batch = wmr_afl.run_batch("track_type_1_1", parameters={"m": [60.0, 80.0, 120.0]}, since=20.0)
    assert batch.rms.max() < 1e-3


def test_guesses_and_what_is_relative_to_them_follow_each_robot_of_a_batch(tmp_path: Path) -> None:
    """Gamma and bounds relative to theta_hat(0), which follows from each robot's own parameters besides the guess."""
    drawn = {"m_w": [0.8, 1.4], "d": [0.02, 0.05]}
    text = (EXPERIMENTS / "track_mecanum.toml").read_text().replace("= 65.0", "= 5.0")
    (tmp_path / "base.toml").write_text(text)
    batch = wmr_afl.run_batch(tmp_path / "base.toml", "AFL", parameters=drawn)
    for i in range(2):
        lines = "\n".join(f"{name} = {values[i]}" for name, values in drawn.items())
        (tmp_path / "one.toml").write_text(text.replace("[start]", f"[parameters]\n{lines}\n\n[start]", 1))
        one = wmr_afl.run(tmp_path / "one.toml", controllers="AFL")["AFL"]
        np.testing.assert_allclose(batch.rms[i], one.rms(), rtol=1e-9)


def test_noise_of_a_batch_is_each_seeds_own(tmp_path: Path) -> None:
    text = (EXPERIMENTS / "study_1.toml").read_text().replace("duration = 140.0", "duration = 30.0")
    noise = "[uncertainties]\nmeasurement_noise = {{ deviation = 0.001, seed = {} }}\n[shared]"
    batch = None
    for seed in (3, 4):
        (tmp_path / "noisy.toml").write_text(text.replace("[shared]", noise.format(seed), 1))
        batch = batch or wmr_afl.run_batch(tmp_path / "noisy.toml", seeds=[3, 4])
        one = wmr_afl.run(tmp_path / "noisy.toml", controllers="AFL")["AFL"]
        np.testing.assert_allclose(batch.rms[seed - 3], one.rms(), rtol=1e-9)


def test_a_batch_does_not_depend_on_threads_blocks_or_backend() -> None:
    random = np.random.default_rng(0)
    start = {"x": random.uniform(14.0, 16.0, 70), "phi": random.uniform(-0.3, 0.3, 70)}
    first, second = (wmr_afl.run_batch("study_1", start=start, threads=threads) for threads in (1, 2))
    assert first.final_state.tobytes() == second.final_state.tobytes()
    some = {name: column[40:43] for name, column in start.items()}
    few = wmr_afl.run_batch("study_1", start=some)
    np.testing.assert_allclose(few.final_state, first.final_state[40:43], rtol=1e-12, atol=1e-12)
    interpreted = wmr_afl.run_batch("study_1", start=some, backend="casadi")
    np.testing.assert_allclose(interpreted.rms, few.rms, rtol=1e-9)
    np.testing.assert_allclose(interpreted.largest_error, few.largest_error, rtol=1e-9)


def test_a_robot_that_fails_is_reported_and_the_others_go_on(tmp_path: Path) -> None:
    text = (EXPERIMENTS / "study_1.toml").read_text().replace("lower = 0.1", "lower = 1e-14")
    (tmp_path / "wild.toml").write_text(text)
    batch = wmr_afl.run_batch(tmp_path / "wild.toml", start={"x": [15.0, 15.0]}, values={"lower": np.vstack([
        np.full(6, 1e-14), np.array([-np.inf, -np.inf, -np.inf, -np.inf, 0.1, 0.1])])})  # fmt: skip
    assert batch.failed.tolist() == [True, False]
    assert 0.0 < batch.failure_time[0] < 2.0
    assert np.isinf(batch.rms[0]).all()
    assert batch.rms[1].max() < 1.0


@pytest.mark.parametrize("backend", ["compiled", "casadi"])
def test_a_robot_that_diverges_never_disturbs_its_neighbours(backend: str) -> None:
    """Not by a bit, wherever it stands in the block."""
    y = np.linspace(25.0, 25.5, 5)
    calm = wmr_afl.run_batch("study_1", start={"y": y}, backend=backend)
    assert not calm.failed.any()
    for place in (0, 2, 5):
        wild = wmr_afl.run_batch("study_1", start={"y": np.insert(y, place, 1e200)}, backend=backend)
        assert wild.failed.tolist() == [index == place for index in range(6)]
        for name in ("rms", "largest_error", "largest_input", "largest_estimate", "final_state"):
            assert np.delete(getattr(wild, name), place, axis=0).tobytes() == getattr(calm, name).tobytes()


@pytest.mark.parametrize(
    ("call", "kind", "words"),
    [
        (lambda: wmr_afl.run_batch("study_1"), ShapeError, "how many robots"),
        (lambda: wmr_afl.run_batch("study_1", start={"x": [1.0, 2.0], "y": [1.0]}), ShapeError, "differ"),
        (lambda: wmr_afl.run_batch("study_1", start={"z": [1.0, 2.0]}), UnknownNameError, "phi"),
        (lambda: wmr_afl.run_batch("study_1", parameters={"mass": [1.0]}), UnknownNameError, "m_C"),
        (lambda: wmr_afl.run_batch("study_1", values={"gain": [1.0]}), UnknownNameError, "Gamma"),
        (lambda: wmr_afl.run_batch("study_1", values={"Gamma": [[1.0, 2.0]]}), ShapeError, "Gamma"),
        (lambda: wmr_afl.run_batch("study_1", values={"b1": [math.nan]}), WmrError, "outer_loop.b1 is not finite"),
        (lambda: wmr_afl.run_batch("study_1", start={"x": [math.nan]}), WmrError, "x is not finite"),
        (lambda: wmr_afl.run_batch("study_1", parameters={"m_C": [1.0, -2.0]}), WmrError, "m_C = -2 kg is negative"),
        (lambda: wmr_afl.run_batch("study_1", scale={"mass": [1.0]}), UnknownNameError, "m_C"),
        (lambda: wmr_afl.run_batch("study_1", start={"x": [1.0]}, since=140.1), SimulationError, "from 0 to 140 s"),
        (lambda: wmr_afl.run_batch("study_1", start={"x": [1.0]}, since=-1.0), SimulationError, "from 0 to 140 s"),
        (lambda: wmr_afl.run_batch("study_1", "PID", start={"x": [1.0]}), UnknownNameError, "AFL"),
        (lambda: wmr_afl.run_batch("study_1", start={"x": [1.0]}, backend="numpy"), UnknownNameError, "compiled"),
    ],
)
def test_a_batch_that_means_nothing_is_refused(call, kind: type[Exception], words: str) -> None:
    with pytest.raises(kind, match=words):
        call()
