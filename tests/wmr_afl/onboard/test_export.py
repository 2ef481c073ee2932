"""A controller carried away as C: builds without a warning anywhere, does what Python does, refuses what it cannot."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

import wmr_afl
from benchmarks.exported import SANITIZED, STRICT, Law, built, fuzzed, tracked
from tests.conftest import EXPERIMENTS
from wmr_afl import ArgumentError, Controller, InputError, UnknownNameError, WmrError
from wmr_afl.controllers.live_reference import BufferState, ReferenceBuffer
from wmr_afl.experiments.load import load_experiment
from wmr_afl.onboard.export import export, onboard
from wmr_afl.simulation.kernels.c_compiler import compiler

pytestmark = pytest.mark.skipif(compiler() is None, reason="there is no C compiler")

EVERY = [(experiment, name) for experiment in wmr_afl.list_experiments() for name in load_experiment(experiment).loops]
KINDS = [  # of laws, robots and precisions
    ("study_1", "AFL", False), ("study_2", "robust AFL", True), ("track_mecanum", "AFL", True),
    ("track_car", "composite", True), ("study_2_pose", "pose", False), ("track_type_2_0_uneven", "direct", False),
]  # fmt: skip


def replayed(folder: Path, flags: list[str]) -> str:
    done = subprocess.run([built(folder, flags, "replay"), "vectors.txt"], capture_output=True, text=True, cwd=folder)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize(("experiment", "name"), EVERY)
def test_a_replay_does_what_python_did(experiment: str, name: str, tmp_path: Path) -> None:
    """To the bit in double precision; in single precision as near as rounded inputs allow.

    Every shipped controller in one of the two, by turns; `python -m benchmarks.embedded --hosts` tries both.
    """
    is_single = EVERY.index((experiment, name)) % 2 == 1
    export(experiment, name, tmp_path / "c", is_single=is_single, is_unlimited=True, has_reference=False, samples=60)
    (tmp_path / "c/controller_buffer.c").unlink()
    told = replayed(tmp_path / "c", [*STRICT, "-O1"])
    assert is_single or "within 0 of Python's" in told


@pytest.mark.parametrize(("experiment", "name", "is_single"), [KINDS[1], KINDS[3], KINDS[4]])
def test_tunable_gains_and_names_of_ones_own_change_no_number(
    experiment: str, name: str, is_single: bool, tmp_path: Path
) -> None:
    """Gains as an argument of each step give the numbers of gains that are built in; no sanitizer finds anything."""
    export(
        experiment, name, tmp_path / "c", is_single=is_single, is_unlimited=True, samples=100, prefix="my_robot",
        is_tunable=True, has_reference=False, gate=None if "pose" in experiment else 0.5,
    )  # fmt: skip
    replayed(tmp_path / "c", SANITIZED)


def test_two_controllers_live_in_one_program(tmp_path: Path) -> None:
    """With prefixes of their own; the headers are those of C++, too."""
    for prefix in ("left", "right"):
        export("study_1", "AFL", tmp_path / prefix, prefix=prefix, is_unlimited=True, samples=5)
        (tmp_path / prefix / "main.c").unlink()
        for path in (tmp_path / prefix).glob("*.[ch]"):
            path.rename(tmp_path / path.name)
    (tmp_path / "both.c").write_text(
        '#include "left.h"\n#include "right.h"\n#include "left_buffer.h"\n#include "right_buffer.h"\n'
        "int main(void) { left_state a; right_state b; left_init(&a); right_init(&b); return a.z[0] != b.z[0]; }\n"
    )
    subprocess.run([built(tmp_path, STRICT, "both")], check=True)


def test_the_same_input_gives_the_same_bytes_and_stands_on_its_own(tmp_path: Path) -> None:
    """No path, no date; a folder that is copied away builds by CMake's file, which names what lies in it."""
    files = [export("study_2", "AFL", tmp_path / name, layout="platformio", samples=20) for name in ("a", "b")]
    assert files[0] == files[1]
    assert {path.name: path.read_text() for path in (tmp_path / "a").iterdir()} == files[0]
    whole = "".join(files[0].values())
    assert str(tmp_path) not in whole
    assert json.loads(files[0]["library.json"])["name"] == "controller"
    for source in ("controller.c", "controller_buffer.c", "controller_reference.c"):
        assert source in files[0]["CMakeLists.txt"]


def test_the_readme_tells_every_wire(tmp_path: Path) -> None:
    """Each entry of each array with its index, name and unit, and the limits."""
    for experiment, name in (("track_mecanum", "AFL"), ("study_2_pose", "pose")):
        loop = load_experiment(experiment).loops[name]
        files = export(experiment, name, tmp_path / experiment, samples=2)
        for letter, entries in (
            ("X", onboard(loop).measured),
            ("U", loop.model.input_units),
            ("Y", loop.model.output_units),
        ):
            for i, entry in enumerate(entries):
                assert f"| {i} | `CONTROLLER_{letter}_{entry}` |" in files["README.md"]
        assert "input_limits.volts" in files["README.md"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"experiment": "study_1"}, "nothing limits the voltages of 'AFL'; add command_limits"),
        ({"controller": "PID"}, "unknown controller 'PID'"),
        ({"experiment": "nowhere"}, "nowhere"),
        ({"prefix": "3x"}, "is no name in C"),
        ({"prefix": "while"}, "is no name in C"),
        ({"prefix": "a b"}, "is no name in C"),
        ({"layout": "maven"}, "unknown layout 'maven'"),
        ({"samples": 0}, "choose 1 to 1000000"),
        ({"samples": 10**9}, "choose 1 to 1000000"),
    ],
)  # fmt: skip
def test_what_cannot_be_exported_is_refused_and_leaves_nothing(options: dict, words: str, tmp_path: Path) -> None:
    with pytest.raises((WmrError, InputError, UnknownNameError, ArgumentError), match=words):
        export(**{"experiment": "study_2", "out": tmp_path / "c", **options})
    assert not any(tmp_path.iterdir())


def test_a_controllers_name_is_text_in_c_and_nothing_else(tmp_path: Path) -> None:
    """It ends no comment and continues no line."""
    text = (EXPERIMENTS / "study_2.toml").read_text()
    name = "x */ int injected; /* ??/ \\\\ y"
    assert "[controllers.AFL]" in text
    (tmp_path / "odd.toml").write_text(text.replace("[controllers.AFL]", f'[controllers."{name}"]'))
    export(tmp_path / "odd.toml", name.replace("\\\\", "\\"), tmp_path / "c", samples=3)
    replayed(tmp_path / "c", STRICT)
    assert "injected; / *" in (tmp_path / "c/controller.c").read_text()


def test_limits_of_commands_are_told_and_hold_whatever_was_before(tmp_path: Path) -> None:
    """Also after a state that was saved under wider limits: it begins at rest."""
    text = (EXPERIMENTS / "study_1.toml").read_text()
    limits = "command_limits = { most = [3.0, 4.0], least = -2.0, slew = 40.0 }"
    (tmp_path / "limited.toml").write_text(text.replace("[shared]", f"[uncertainties]\n{limits}\n\n[shared]", 1))
    files = export(tmp_path / "limited.toml", samples=5)
    assert "command_limits.most = [3.0, 4.0] V" in str(files["README.md"])
    controller = Controller.from_experiment(tmp_path / "limited.toml", is_live=True)
    wide = {"command_limits.last": [50.0, -50.0]}
    x, wanted = [15.0, 25.0, 0.1, 0.2, 0.05], ([30.0, 40.0], [0.0, 0.0], [0.0, 0.0])
    controller.load_state(wide)
    assert np.all(np.abs(controller.update(0.0, x, wanted)) <= 0.8 + 1e-12)
    np.testing.assert_array_equal(controller.state_dict()["command_limits.last"], controller.update(0.0, x, wanted))


def test_a_folder_that_exists_and_a_reference_that_is_a_table_are_refused(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    with pytest.raises(WmrError, match="there exists; choose the name of a new folder"):
        export("study_2", out=tmp_path / "there")
    text = (EXPERIMENTS / "study_1.toml").read_text()
    circle = "circle = { center = [10.0, 25.0], radius = 7.5, rate = 0.05 }"
    points = "waypoints = { points = { t = [0.0, 5.0, 9.0], y1 = [15.0, 16.0, 16.5], y2 = [25.0, 25.5, 27.0] } }"
    assert circle in text
    (tmp_path / "table.toml").write_text(text.replace(circle, points))
    with pytest.raises(WmrError, match="export with --no-reference and push its points into the buffer"):
        export(tmp_path / "table.toml", out=tmp_path / "c", is_unlimited=True)
    export(tmp_path / "table.toml", out=tmp_path / "c", is_unlimited=True, has_reference=False, samples=50)
    replayed(tmp_path / "c", STRICT)


REFERENCE = """
#include "controller_reference.h"
#include <stdio.h>
int main(void)
{
    for (int i = 0; i < 400; i++) {
        controller_setpoint r;
        controller_reference(0.37 * i, &r);
        for (int j = 0; j < CONTROLLER_Y; j++)
            printf("%.17g %.17g %.17g\\n", r.position[j], r.velocity[j], r.acceleration[j]);
    }
    return 0;
}
"""


def test_the_reference_in_c_is_that_of_the_experiment(tmp_path: Path) -> None:
    """Formulas with all their functions, against the same in Python."""
    text = (EXPERIMENTS / "study_1.toml").read_text()
    formulas = {
        "y1": "15 + tanh(t - 20) + sqrt(1 + t) + abs(sin(t/9))",
        "y2": "25 + exp(-t/50) + sign(t - 30) + cos(0.2*t)",
    }
    circle = "circle = { center = [10.0, 25.0], radius = 7.5, rate = 0.05 }"
    told = ", ".join(f'{name} = "{formula}"' for name, formula in formulas.items())
    (tmp_path / "odd.toml").write_text(text.replace(circle, f"expressions = {{ {told} }}"))
    export(tmp_path / "odd.toml", out=tmp_path / "c", is_unlimited=True, samples=2)
    (tmp_path / "c/main.c").write_text(REFERENCE)
    done = subprocess.run([built(tmp_path / "c", STRICT, "reference")], capture_output=True, text=True, check=True)
    found = np.array([line.split() for line in done.stdout.splitlines()], dtype=float).reshape(400, 2, 3)
    wanted = np.stack(load_experiment(tmp_path / "odd.toml").loops["AFL"].reference.over(0.37 * np.arange(400)), axis=2)
    np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize(
    "loop_name", [("study_1", "AFL"), ("track_tractor_3_trailers", "exact"), ("track_car", "composite")]
)
def test_a_robot_in_single_precision_tracks_as_well(loop_name: tuple[str, str], tmp_path: Path) -> None:
    """The robot itself in double precision: the root mean square of its error within one percent."""
    loop = load_experiment(loop_name[0]).loops[loop_name[1]]
    by_python, by_c = (tracked(loop, law, 1500) for law in (None, Law(loop, tmp_path / "c", True)))
    rms = [np.sqrt(np.mean(np.sum(errors**2, axis=1))) for errors in (by_python, by_c)]
    assert rms[1] == pytest.approx(rms[0], rel=0.01)


def test_estimates_in_single_precision_do_not_stall(tmp_path: Path) -> None:
    """At 1 kHz, under an error of 0.1 mm: a change of an estimate is far below the last digit of the estimate."""
    text = (EXPERIMENTS / "study_1.toml").read_text().replace("sample_time = 0.02", "sample_time = 0.001")
    assert "0.001" in text
    (tmp_path / "fast.toml").write_text(text)
    loop = load_experiment(tmp_path / "fast.toml").loops["AFL"]
    x = np.array([1.0, 2.0, 0.3, 0.5, 0.2])
    model = loop.model.in_library("numpy")
    y, rate = model.output(x[:3], loop.law.knowledge.known), model.output_rate(x, loop.law.knowledge.known)
    setpoint = np.concatenate([y - 1e-4, rate, np.zeros(2)])
    moved = {}
    for is_single in (False, True):
        law = Law(loop, tmp_path / str(is_single), is_single)
        before = law.state
        for _ in range(20_000):
            assert law.step(0.001, x, setpoint) == 0
        moved[is_single] = law.state - before
    assert np.abs(moved[False]).max() > 1e-4
    np.testing.assert_allclose(moved[True], moved[False], rtol=0.02, atol=2e-6)


@pytest.mark.parametrize(("experiment", "name", "is_single"), KINDS)
def test_whatever_it_is_given_voltages_are_finite_and_a_refusal_changes_no_bit(
    experiment: str, name: str, is_single: bool, tmp_path: Path
) -> None:
    """Any bits in any argument and in the state, under sanitizers."""
    folder = tmp_path / "c"
    export(experiment, name, folder, is_single=is_single, is_unlimited=True, has_reference=False, samples=2)
    counts = fuzzed(folder, 20_000)
    assert all(counts[status] > 0 for status in (0, 1, 2, 3)), counts


BUFFER = """
#include "controller_buffer.h"
#include <stdio.h>
int main(void)
{
    controller_buffer buffer;
    uint32_t start, timeout, stop, t;
    int kind;
    controller_setpoint r;
    if (scanf("%u %u %u", &start, &timeout, &stop) != 3) return 2;
    controller_buffer_init(&buffer, timeout, stop);
    while (scanf("%d %u", &kind, &t) == 2) {
        if (kind == 1) {
            for (int j = 0; j < CONTROLLER_Y; j++)
                if (scanf("%lf %lf %lf", &r.position[j], &r.velocity[j], &r.acceleration[j]) != 3) return 2;
            printf("%d\\n", (int)controller_buffer_push(&buffer, start + t, &r));
        } else if (kind == 2) {
            controller_buffer_resume(&buffer);
            puts("0");
        } else {
            const controller_buffer_status status = controller_buffer_at(&buffer, start + t, &r);
            printf("%d", (int)status);
            for (int j = 0; j < CONTROLLER_Y; j++)
                printf(" %.17g %.17g %.17g", r.position[j], r.velocity[j], r.acceleration[j]);
            puts("");
        }
    }
    return 0;
}
"""
STATES = [BufferState.EMPTY, BufferState.FRESH, BufferState.HOLDING, BufferState.STOPPING, BufferState.STOPPED]


@pytest.mark.parametrize("start", [0, 2**32 - 700_000], ids=["from zero", "over the clock's end"])
def test_the_buffer_in_c_gives_what_pythons_gives(start: int, tmp_path: Path) -> None:
    """Between points, holding, stopping, stopped; the same states and numbers, also while the clock begins again."""
    export("study_1", "AFL", tmp_path / "c", is_unlimited=True, has_reference=False, samples=2)
    (tmp_path / "c/main.c").write_text(BUFFER)
    program = built(tmp_path / "c", [*WITHOUT_PROMOTION, "-DCONTROLLER_POINTS=8u"], "buffer")
    python, lines, wanted = ReferenceBuffer(["y1", "y2"], timeout=0.4, stop=0.8, room=64), [], []
    random = np.random.default_rng(3)
    for k in range(300):
        us = 10_000 * k
        if k % 10 == 0 and k <= 120:
            row = random.normal(size=(2, 3)).round(3)
            lines.append(f"1 {us + 150_000} " + " ".join(map(repr, row.ravel().tolist())))
            python.push(1e-6 * (us + 150_000), *row.T)
            wanted.append([0.0])
        lines.append(f"0 {us + 3}")  # away from the moments at which states change, which rounding may shift
        now = np.array(python.at(1e-6 * (us + 3)))
        wanted.append([float(STATES.index(python.state)), *now.T.ravel()])
    done = subprocess.run(
        [program], input="\n".join([f"{start} 400000 800000", *lines]), capture_output=True, text=True, check=True
    )
    found = [[float(one) for one in line.split()] for line in done.stdout.splitlines()]
    assert {int(row[0]) for row in found} == {0, 1, 2, 3, 4}
    for row, right in zip(found, wanted, strict=True):
        assert row[0] == right[0]
        np.testing.assert_allclose(row[1:], right[1:], rtol=1e-9, atol=1e-9)


WITHOUT_PROMOTION = [flag for flag in STRICT if flag != "-Wdouble-promotion"]


def test_the_buffer_in_c_refuses_what_pythons_refuses(tmp_path: Path) -> None:
    """What is not later, not finite, or beyond the room; and everything once it stops, until it resumes."""
    export("study_1", "AFL", tmp_path / "c", is_unlimited=True, has_reference=False, samples=2)
    (tmp_path / "c/main.c").write_text(BUFFER)
    program = built(tmp_path / "c", [*WITHOUT_PROMOTION, "-DCONTROLLER_POINTS=3u"], "buffer")
    one, bad = "0.1 0.2 0.0 0.3 0.4 0.0", "nan 0.2 0.0 0.3 0.4 0.0"
    script = [
        ("0 0", "0"), (f"1 1000 {one}", "0"), (f"1 1000 {one}", "2"), (f"1 2000 {bad}", "1"), (f"1 2000 {one}", "0"),
        (f"1 3000 {one}", "0"), (f"1 4000 {one}", "3"), ("0 2500", "1"), (f"1 4000 {one}", "0"), ("0 4100", "2"),
        ("0 900000", "4"), (f"1 950000 {one}", "4"), ("2 0", "0"), (f"1 950000 {one}", "0"), ("0 950000", "1"),
    ]  # fmt: skip
    done = subprocess.run(
        [program],
        input="\n".join(["0 1000 2000", *(line for line, _ in script)]),
        capture_output=True,
        text=True,
        check=True,
    )
    assert [line.split()[0] for line in done.stdout.splitlines()] == [answer for _, answer in script]
