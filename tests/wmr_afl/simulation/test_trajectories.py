"""Trajectories of a batch on disk: all samples of all runs, in memory only a few."""

import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

import wmr_afl
from tests.conftest import ROOT
from wmr_afl import WmrError
from wmr_afl.experiments.load import load_experiment
from wmr_afl.simulation import trajectories

h5py = pytest.importorskip("h5py")


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("backend", ["auto", "casadi"])
def test_the_file_holds_what_single_runs_give(tmp_path: Path, threads: int, backend: str) -> None:
    scale = {"m_C": np.linspace(0.9, 1.1, 40 if backend == "auto" else 3)}
    batch = wmr_afl.run_batch(
        "study_1", scale=scale, threads=threads, backend=backend, trajectories=tmp_path / "runs.h5"
    )
    plain = wmr_afl.run_batch("study_1", scale=scale, backend=backend)
    np.testing.assert_allclose(batch.rms, plain.rms, rtol=1e-9)
    with h5py.File(tmp_path / "runs.h5") as file:
        assert file.attrs["model"] == "type_2_0"
        assert list(file["state"].attrs["names"]) == ["x [m]", "y [m]", "phi [rad]", "v [m/s]", "omega [rad/s]"]
        assert file["state"].shape == (len(scale["m_C"]), 7001, 5)
        errors = file["error"][:]
        np.testing.assert_allclose(np.sqrt(np.mean(errors**2, axis=1)), batch.rms, rtol=1e-9)
        nominal = wmr_afl.run("study_1", controllers="AFL")["AFL"]
        middle = wmr_afl.run_batch("study_1", scale={"m_C": [1.0]}, trajectories=tmp_path / "one.h5")
        with h5py.File(tmp_path / "one.h5") as one:
            for name in ("time", "state", "input", "command", "error", "reference", "estimate"):
                there = one[name][:] if name == "time" else one[name][0]
                np.testing.assert_allclose(there, getattr(nominal, name), rtol=1e-9, atol=1e-9)
        assert middle.rms.shape == (1, 2)
    assert not list(tmp_path.glob("*.part"))


def test_the_file_holds_deviations_where_the_law_knows_them(tmp_path: Path) -> None:
    wmr_afl.run_batch("payload_type_2_0", "composite", scale={"m_C": [1.0]}, trajectories=tmp_path / "runs.h5")
    run = wmr_afl.run("payload_type_2_0", controllers="composite")["composite"]
    with h5py.File(tmp_path / "runs.h5") as file:
        assert list(file["deviation"].attrs["names"]) == list(file["estimate"].attrs["names"])
        np.testing.assert_allclose(file["deviation"][0], run.deviation, rtol=1e-9)


@pytest.mark.parametrize("backend", ["compiled", "casadi"])
def test_a_failure_is_marked_in_the_file(tmp_path: Path, backend: str) -> None:
    """Three starts, of which some fail within the first second: the file agrees with the summaries."""
    start = {"x": [15.0, 14.0, 14.1], "y": [25.0, 24.0, 24.1], "phi": [0.0, -0.5, -0.5]}
    batch = wmr_afl.run_batch("study_1", start=start, backend=backend, trajectories=tmp_path / "runs.h5")
    assert batch.failed.any()
    assert not batch.failed.all()
    with h5py.File(tmp_path / "runs.h5") as file:
        np.testing.assert_array_equal(file["failure_time"][:], batch.failure_time)
        assert list(file["failure_time"].attrs["names"]) == ["failure_time [s]"]
        time = file["time"][:]
        for name in ("state", "input", "command", "error", "reference", "estimate"):
            finite = np.isfinite(file[name][:]).all(axis=2)
            for robot, failure in enumerate(batch.failure_time):
                np.testing.assert_array_equal(finite[robot], ~(time >= failure), err_msg=name)


def test_an_existing_file_stays_until_the_new_one_is_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "runs.h5"
    wmr_afl.run_batch("study_1", scale={"m_C": [1.0]}, trajectories=file)
    before = file.read_bytes()

    def interrupt(done: int) -> None:
        assert file.read_bytes() == before
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        wmr_afl.run_batch("study_1", scale={"m_C": [1.1]}, trajectories=file, progress=interrupt)
    assert file.read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["runs.h5"]
    (tmp_path / "link.h5").symlink_to(file)
    wmr_afl.run_batch("study_1", scale={"m_C": [1.1]}, trajectories=tmp_path / "link.h5")
    assert file.read_bytes() == before


def test_the_file_is_whole_when_it_takes_its_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A kill right afterwards leaves all that was written: nothing of it waits for the file to be closed."""
    seen = {}

    def finished(beside: Path, path: Path) -> None:
        (tmp_path / "copy.h5").write_bytes(beside.read_bytes())
        with h5py.File(tmp_path / "copy.h5") as file:
            seen.update({name: file[name][:] for name in file})

    monkeypatch.setattr(trajectories, "finish", finished)
    loop = load_experiment("study_1").loops["AFL"]
    times, count = np.array([0.0, 0.02, 0.04]), 2
    rows = np.ones((3, loop.signal_layout.size, count))
    with trajectories.recording(tmp_path / "runs.h5", loop, times, count) as record:
        record(slice(0, 2), slice(0, 3), rows)
    signals = {name for signal, name in trajectories.DATASETS.items() if signal in loop.signals}
    assert set(seen) == {"time", "failure_time", *signals}
    assert all(np.all(seen[name] == 1.0) for name in signals)
    np.testing.assert_array_equal(seen["time"], times)


def test_memory_does_not_grow_with_the_number_of_runs(tmp_path: Path) -> None:
    def peak(robots: int) -> int:
        tracemalloc.start()
        wmr_afl.run_batch("study_1", scale={"m_C": np.linspace(0.9, 1.1, robots)}, trajectories=tmp_path / "runs.h5")
        found = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return found

    few, many = peak(32), peak(256)
    assert many < few + 2_000_000  # bytes; the samples of 256 runs are 200 MB
    assert (tmp_path / "runs.h5").stat().st_size > 200_000_000


SCRIPT = """
import resource, sys, wmr_afl
resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, 1_000_000))
try:
    wmr_afl.run_batch("study_1", scale={"m_C": [1.0] * 40}, trajectories=sys.argv[1], backend="casadi")
except wmr_afl.WmrError as error:
    print(error)
"""


def test_a_full_disk_leaves_no_half_written_file(tmp_path: Path) -> None:
    """The limit on the size of a file stands for the room that there is."""
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(tmp_path / "runs.h5")], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")  # neither a crash nor tracebacks that Python could not raise
    assert "runs.h5: cannot be written" in done.stdout
    assert len(done.stdout.splitlines()) == 1, done.stdout
    assert not list(tmp_path.iterdir())


def test_a_place_that_cannot_be_written_is_reported_before_the_work(tmp_path: Path) -> None:
    with pytest.raises(WmrError, match=r"runs.h5: cannot be written"):
        wmr_afl.run_batch("study_1", scale={"m_C": [1.0]}, trajectories=tmp_path / "nowhere" / "runs.h5")


def test_without_h5py_one_line_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(WmrError, match=r"wmr-afl\[trajectories\]"):
        wmr_afl.run_batch("study_1", scale={"m_C": [1.0]}, trajectories=tmp_path / "runs.h5")
