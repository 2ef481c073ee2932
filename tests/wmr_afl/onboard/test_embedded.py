"""An exported controller does on a microcontroller, as QEMU runs it, what it does here."""

from pathlib import Path

import pytest

from benchmarks.embedded import REACHED, example, of_the_example
from benchmarks.microcontroller import M4F, Replay, missing, replayed_on_core, replayed_on_host
from wmr_afl.onboard.export import export
from wmr_afl.simulation.kernels.c_compiler import compiler

SAMPLES = 100

pytestmark = pytest.mark.skipif(bool(missing()), reason=f"{', '.join(missing())} missing; see make embedded")


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("exported")
    export("study_1", "AFL", folder / "export", is_single=True, is_unlimited=True, samples=SAMPLES)
    return folder


def test_a_step_gives_the_hosts_bits_holds_no_data_and_is_short(exported: Path) -> None:
    replay, size, cost = replayed_on_core(M4F, exported / "export", exported)
    assert replay.off < 1e-5
    assert (size.data, size.bss) == (0, 0)
    assert 100 < cost.least <= cost.mean <= cost.most < 700
    assert cost.most - cost.least < 20  # no loop depends on data
    assert 0 < cost.stack < 1024
    host = compiler()
    if host is not None and len(host) == 1:
        assert replayed_on_host(host[0], exported / "export", exported) == Replay(replay.off, replay.bits)


def test_a_robot_whose_setpoints_end_comes_to_rest(tmp_path: Path) -> None:
    printed = example(of_the_example(tmp_path))
    streams = [line.split()[2] for line in printed.splitlines()[:-1]]
    assert list(dict.fromkeys(streams)) == ["empty", "fresh", "holding", "stopping", "stopped"]
    assert printed.endswith(REACHED)
