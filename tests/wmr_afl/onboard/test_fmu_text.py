"""What an FMU tells of its values, before any of it is compiled."""

import io
import json
import platform
import re
import xml.etree.ElementTree as ET
import zipfile
from dataclasses import replace
from math import inf, nan
from pathlib import Path
from typing import Any
from uuid import UUID

import numpy as np
import pytest

from tests.conftest import EXPERIMENTS
from wmr_afl import BackendWarning, CompilerError, UnknownNameError
from wmr_afl.experiments.load import load_experiment
from wmr_afl.onboard import cosimulation, fmu
from wmr_afl.onboard.c_source import Source
from wmr_afl.onboard.cosimulation import check_version, controller_fmu, fmus, plant_fmu, plant_name
from wmr_afl.onboard.export import onboard
from wmr_afl.onboard.fmu import Fmu, Variable, binary, packed
from wmr_afl.onboard.status import Status
from wmr_afl.simulation.closed_loop import ClosedLoop

NOISE = (
    "[uncertainties]\nmeasurement_noise = { deviation = 0.01, seed = 3 }\ninput_delay = { seconds = 0.04 }\n\n[shared]"
)
REFERENCE = {"my_reference.h": "the header", "my_reference.c": "the code", "README.md": "not of the reference"}


def loop_of(experiment: str = "study_1", name: str = "AFL") -> ClosedLoop:
    return load_experiment(experiment).loops[name]


def law(loop: ClosedLoop, files: dict[str, str] | None = None, **options: Any) -> Fmu:
    return controller_fmu(Source(onboard(loop), "my", **options), 7.0, files or {})


def robot(loop: ClosedLoop) -> Fmu:
    return plant_fmu(Source(onboard(loop), "my"), loop, 7.0)


def named(one: Fmu, group: str) -> dict[str, Variable]:
    return {variable.name: variable for variable in one.groups.get(group, [])}


@pytest.mark.parametrize(
    ("experiment", "name"), [("study_1", "AFL"), ("study_2_pose", "pose"), ("track_car", "composite")]
)
def test_controller_and_robot_can_be_wired_by_name(experiment: str, name: str) -> None:
    """What the one puts out the other takes in, with the same unit."""
    loop = loop_of(experiment, name)
    one, other = law(loop), robot(loop)
    for group, giver, taker in (("measured", other, one), ("voltage", one, other)):
        given, taken = named(giver, group), named(taker, group)
        assert [(v.name, v.unit) for v in given.values()] == [(v.name, v.unit) for v in taken.values()]
        assert {v.causality for v in given.values()} == {"output"}
        assert {v.causality for v in taken.values()} == {"input"}
    assert [v.name for v in one.groups["measured"]] == [f"measured.{entry}" for entry in onboard(loop).measured]
    assert {v.unit for v in one.groups["voltage"]} == {"V"}
    assert (one.name, other.name, one.duration, one.sample_time) == ("my", "my_plant", 7.0, loop.sample_time)
    assert other.sample_time == loop.sample_time
    assert (one.is_any_step, other.is_any_step) == (True, True)


def test_a_setpoint_is_told_with_its_rates() -> None:
    one, outputs = law(loop_of()), loop_of().model.output_units
    for group, ending, per, symbol in (
        ("position", "", "", "yr"), ("velocity", "_rate", "/s", "yr'"),
        ("acceleration", "_acceleration", "/s^2", "yr''"),
    ):  # fmt: skip
        found = [(v.name, v.unit, v.about, v.causality) for v in one.groups[group]]
        assert found == [
            (f"reference{ending}.{name}", unit + per, f"{symbol}: where to be", "input")
            for name, unit in outputs.items()
        ]


def test_gains_are_told_only_if_they_may_be_set() -> None:
    """Each number of each array, where its C expects it; known constants with their names and units."""
    loop = loop_of()
    assert "gains" not in law(loop).groups
    one, sampled = law(loop, is_tunable=True), onboard(loop)
    gains = one.groups["gains"]
    assert [v.value for v in gains] == [float(v) for value in sampled.values.values() for v in np.ravel(value)]
    assert {(v.causality, v.variability) for v in gains} == {("parameter", "tunable")}
    known = named(one, "gains")
    assert {name: v.unit for name, v in known.items() if name.startswith("gains.c.")} == {
        f"gains.c.{name}": unit for name, unit in loop.model.known_units.items()
    }
    assert known["gains.outer_loop.b1[2]"].value == sampled.values["outer_loop.b1"][1]
    places = one.context["gain_places"]
    assert [place for _, _, place in places] == list(range(len(gains)))
    for (name, i, _), v in zip(places, gains, strict=True):
        assert v.name.removeprefix("gains.").replace(".", "_").startswith(name)
        assert v.name.endswith(f"[{i + 1}]") or "[" not in v.name


def test_what_a_controller_puts_out_has_units() -> None:
    loop = loop_of("study_2_pose", "pose")
    one, model = law(loop), loop.model
    place = onboard(loop).states.places["theta_hat"]
    assert one.context["estimates"] == list(range(place.start, place.stop))
    knowledge = loop.law.knowledge
    formulas = model.formulas_of(knowledge.estimated)
    assert [(v.name, v.unit, v.about) for v in one.groups["estimate"]] == [
        (f"estimate.{name}", unit, f"estimate of {formulas[name]}") for name, unit in knowledge.units.items()
    ]
    units = {
        "error": {f"error.{name}": unit for name, unit in model.output_units.items()},
        "filtered_error": {f"filtered_error.{name}": f"{unit}/s" for name, unit in model.output_units.items()},
        "command": {f"command.{name}": "V" for name in model.input_units},
        "observed": {f"observed.{name}": unit for name, unit in model.state_units.items()},
        "regularity": {"regularity": ""},
        "surprise": {"surprise": ""},
    }
    assert {group: {v.name: v.unit for v in one.groups[group]} for group in units} == units
    assert {v.causality for group in units for v in one.groups[group]} == {"output"}
    assert "observed" not in law(loop_of()).groups
    assert [(v.name, v.kind) for v in one.wholes] == [(name, "Integer") for name in ("status", "saturated", "at_bound")]
    told = one.wholes[0].about
    for status in Status:
        of_saved = status in (Status.OTHER_LAYOUT, Status.DAMAGED)
        assert (f"{status.value}: {status.meaning}" in told) != of_saved


def test_a_reference_of_its_own_is_followed_unless_it_is_switched_off() -> None:
    """And comes as C; what else was exported does not."""
    one, without = law(loop_of(), REFERENCE), law(loop_of())
    assert [(v.name, v.kind, v.value, v.start) for v in one.truths] == [("own_reference", "Boolean", 1.0, "true")]
    assert one.context["has_reference"] is True
    assert set(one.sources) == {"my.h", "my.c", "my_reference.h", "my_reference.c"}
    assert (without.truths, without.context["has_reference"], set(without.sources)) == ([], False, {"my.h", "my.c"})


def test_a_robot_tells_its_start_its_state_and_its_noise(tmp_path: Path) -> None:
    """Normal numbers by the names of the state; without noise there are none."""
    text = (EXPERIMENTS / "study_1.toml").read_text()
    (tmp_path / "noisy.toml").write_text(text.replace("[shared]", NOISE, 1))
    loop = load_experiment(tmp_path / "noisy.toml").loops["AFL"]
    noisy, quiet, states = robot(loop), robot(loop_of()), loop.model.state_units
    assert [(v.name, v.unit, v.value, v.variability) for v in noisy.groups["start"]] == [
        (f"start.{name}", unit, value, "fixed")
        for (name, unit), value in zip(states.items(), loop.plant.start, strict=True)
    ]
    assert [(v.name, v.unit, v.causality, v.variability) for v in noisy.groups["state"]] == [
        (f"state.{name}", unit, "output", "continuous") for name, unit in states.items()
    ]
    assert [(v.name, v.unit, v.causality) for v in noisy.groups["noise"]] == [
        (f"noise.{name}", "", "input") for name in states
    ]
    assert (noisy.context["has_noise"], quiet.context["has_noise"]) == (True, False)
    assert "noise" not in quiet.groups
    assert (noisy.is_any_step, quiet.is_any_step) == (False, True)  # a delay counts samples
    assert [v.name for v in quiet.groups["numbers"]] == [f"parameters.{name}" for name in loop.model.parameter_units]
    assert {(v.causality, v.variability) for v in noisy.groups["numbers"]} == {("parameter", "tunable")}
    assert noisy.context["states"] == len(states)
    assert (noisy.wholes, noisy.truths, noisy.sources) == ([], [], {})
    other = type("Plant", (), {"plant": type("P", (), {"samples": 2}), "model": loop.model})
    assert [v.name for v in cosimulation._noise(other)] == ["noise[1]", "noise[2]"]  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("variable", "initial", "start"),
    [
        (Variable("a", "", "input", value=2.0), "", "2.0"),
        (Variable("a", "", "parameter", value=-0.5), "exact", "-0.5"),
        (Variable("a", "", "output", value=2.0), "calculated", ""),
        (Variable("a", "", "independent"), "", ""),
        (Variable("a", "", "parameter", value=inf), "exact", "INF"),
        (Variable("a", "", "parameter", value=-inf), "exact", "-INF"),
        (Variable("a", "", "input", value=nan), "", "NaN"),
        (Variable("a", "", "parameter", value=0.0, kind="Boolean"), "exact", "false"),
        (Variable("a", "", "parameter", value=1.0, kind="Boolean"), "exact", "true"),
    ],
    ids=range(9),
)
def test_first_values_are_told_as_xml_tells_them(variable: Variable, initial: str, start: str) -> None:
    assert (variable.initial, variable.start) == (initial, start)


def number(text: str) -> float:
    """Of a literal in C."""
    return float(re.sub(r"double|[()]", "", text))


class Contexts:
    """In the place of templates: what they would read, as JSON."""

    def get_template(self, name: str) -> Any:
        class Template:
            def render(self, context: dict[str, Any]) -> str:
                kept = {key: value for key, value in context.items() if key not in ("variables", "step", "measurement")}
                return json.dumps({"template": name, **kept}, default=str)

        return Template()


@pytest.mark.parametrize("version", [2, 3])
def test_values_are_in_the_order_in_which_fmi_refers_to_them(version: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """First those that may be set at any time, then those before it begins, then those that are computed."""
    loop = loop_of()
    made = law(loop, REFERENCE, is_tunable=True), robot(loop)
    monkeypatch.setattr(fmu, "TEMPLATES", Contexts())
    for one in made:
        files = one.files(version)
        context = json.loads(files[f"sources/{one.name}_fmu.c"])
        assert context["template"] == one.template
        assert json.loads(files["modelDescription.xml"])["template"] == f"fmi{version}.xml.jinja"
        assert ("sources/buildDescription.xml" in files) == (version == 3)
        fixed, found, reals, truths = (context[name] for name in ("fixed", "found", "reals", "truths"))
        assert context["all"] == len(one.variables)
        assert (one.variables[0].name, one.variables[0].causality, one.variables[0].unit) == (
            "time",
            "independent",
            "s",
        )
        for i, v in enumerate(one.variables):
            is_set = v.causality in ("input", "parameter")
            assert (0 < i < fixed) == (is_set and v.variability != "fixed" and v.kind == "Real")
            assert (fixed <= i < found) == (is_set and v.variability == "fixed")
            assert (reals <= i < truths) == (v.kind == "Integer")
            assert (truths <= i) == (v.kind == "Boolean")
        for name, group in one.groups.items():
            begin = context["places"][name]
            assert one.variables[begin : begin + len(group)] == group
        assert len(context["first_reals"]) == reals
        assert [number(text) for text in context["first_reals"]] == [v.value for v in one.variables[:reals]]
        assert context["first_wholes"] == [v.value for v in one.variables[reals:]]
        assert context["outputs"] == [i for i, v in enumerate(one.variables) if v.causality == "output"]
        assert context["units"] == sorted(set(context["units"]))
        assert set(context["units"]) == {v.unit for v in one.variables if v.unit}
        assert context["headers"] == [name for name in one.sources if name.endswith(".h")]
        assert context["compiled"] == [*(name for name in one.sources if name.endswith(".c")), f"{one.name}_fmu.c"]
        assert context["token"] == f"{{{UUID(context['token'])}}}"
        assert context["layout"] == str(UUID(context["token"]))[:8]
        assert context["token"] != f"{{{UUID(int=0)}}}"
        assert float(context["sample_time"]) == one.sample_time
        for path, text in one.sources.items():
            assert files[f"sources/{path}"] == text


def test_the_token_changes_with_the_content_and_with_nothing_else() -> None:
    """So that a state of another FMU is refused."""
    one = law(loop_of())
    tokens = [ET.fromstring(made.files(2)["modelDescription.xml"]).attrib["guid"] for made in (one, law(loop_of()))]  # noqa: S314, our own
    assert tokens[0] == tokens[1]
    for other in (
        replace(one, title="other"),
        replace(one, sources={**one.sources, "my.c": "other"}),
        replace(one, duration=8.0),
    ):
        assert ET.fromstring(other.files(2)["modelDescription.xml"]).attrib["guid"] != tokens[0]  # noqa: S314


def test_the_description_refers_to_each_value_once() -> None:
    """In the XML of FMI 3.0: names, references, units and outputs of all."""
    one = law(loop_of("study_2_pose", "pose"), REFERENCE)
    root = ET.fromstring(one.files(3)["modelDescription.xml"])  # noqa: S314
    listed = list(root.find("ModelVariables") or ())
    assert [(v.attrib["name"], int(v.attrib["valueReference"]), v.attrib.get("unit", "")) for v in listed] == [
        (v.name, i, v.unit) for i, v in enumerate(one.variables)
    ]
    outputs = [int(v.attrib["valueReference"]) for v in root.iter("Output")]
    assert outputs == [i for i, v in enumerate(one.variables) if v.causality == "output"]
    experiment = root.find("DefaultExperiment")
    assert experiment is not None
    assert (float(experiment.attrib["stopTime"]), float(experiment.attrib["stepSize"])) == (7.0, one.sample_time)


@pytest.mark.parametrize(
    ("machine", "system", "version", "place"),
    [
        ("x86_64", "Linux", 2, "binaries/linux64/a.so"),
        ("x86_64", "Linux", 3, "binaries/x86_64-linux/a.so"),
        ("AMD64", "Windows", 2, "binaries/win64/a.dll"),
        ("AMD64", "Windows", 3, "binaries/x86_64-windows/a.dll"),
        ("arm64", "Darwin", 3, "binaries/aarch64-darwin/a.dylib"),
        ("aarch64", "Linux", 3, "binaries/aarch64-linux/a.so"),
    ],
)
def test_a_binary_lies_where_fmi_looks_for_it(
    machine: str, system: str, version: int, place: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Built of the sources alone."""
    built: list[dict[str, str]] = []
    monkeypatch.setattr(platform, "machine", lambda: machine)
    monkeypatch.setattr(platform, "system", lambda: system)
    monkeypatch.setattr(fmu, "portable_library", lambda sources: built.append(dict(sources)) or b"library")
    files = {"sources/a.c": "code", "modelDescription.xml": "description", "sources/b.h": "header"}
    assert binary("a", files, version) == {place: b"library"}
    assert built == [{"a.c": "code", "b.h": "header"}]


@pytest.mark.parametrize(("machine", "system"), [("riscv64", "Linux"), ("x86_64", "Plan9")])
def test_where_fmi_has_no_place_nothing_is_built(machine: str, system: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platform, "machine", lambda: machine)
    monkeypatch.setattr(platform, "system", lambda: system)
    with pytest.raises(CompilerError, match=f"no place for a binary of {system} on {machine}"):
        binary("a", {}, 2)


def test_a_packed_fmu_has_the_same_bytes_whatever_the_order() -> None:
    """Read by anyone; compressed; of no date."""
    files: dict[str, str | bytes] = {"b": "text" * 1000, "a/c": b"bytes"}
    whole = packed(files)
    assert whole == packed(dict(reversed(files.items())))
    assert len(whole) < 1000
    with zipfile.ZipFile(io.BytesIO(whole)) as archive:
        assert archive.namelist() == ["a/c", "b"]
        assert archive.read("b") == ("text" * 1000).encode()
        for entry in archive.infolist():
            assert entry.date_time == (1980, 1, 1, 0, 0, 0)
            assert entry.external_attr >> 16 == 0o100644
            assert (entry.create_system, entry.compress_type) == (3, zipfile.ZIP_DEFLATED)


def test_fmus_of_both_hold_their_texts_and_a_binary_if_there_is_a_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each its own; without one, sources only, which a warning tells with the cause."""
    loop = loop_of()
    source = Source(onboard(loop), "my")
    monkeypatch.setattr(cosimulation, "binary", lambda name, text, version: {f"binaries/{name}{version}": b"library"})
    made = fmus(source, loop, 3, 7.0, REFERENCE)
    assert list(made) == ["my.fmu", "my_plant.fmu"]
    for file, own in (("my.fmu", "my_fmu.c"), ("my_plant.fmu", "my_plant_fmu.c")):
        with zipfile.ZipFile(io.BytesIO(made[file])) as archive:
            names = set(archive.namelist())
            assert {f"sources/{own}", "modelDescription.xml", f"binaries/{file.removesuffix('.fmu')}3"} <= names
            assert ("sources/my_reference.c" in names) == (file == "my.fmu")

    def failing(*arguments: object) -> dict[str, bytes]:
        raise CompilerError("no C compiler was found")

    monkeypatch.setattr(cosimulation, "binary", failing)
    with pytest.warns(
        BackendWarning, match="^no C compiler was found, so the FMUs hold sources only; install a C compiler"
    ):
        made = fmus(source, loop, 2, 7.0, {})
    for content in made.values():
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            assert not [name for name in archive.namelist() if name.startswith("binaries")]


@pytest.mark.parametrize(("prefix", "name"), [("controller", "plant"), ("my", "my_plant"), ("plant", "plant_plant")])
def test_a_robot_is_named_after_its_controller(prefix: str, name: str) -> None:
    assert plant_name(prefix) == name


def test_versions_of_fmi_are_two_and_three() -> None:
    """And none is no FMU."""
    for version in (None, 2, 3):
        check_version(version)
    for wrong in (1, 4, 0):
        with pytest.raises(UnknownNameError, match=f"unknown version of FMI '{wrong}'; there is 2, 3"):
            check_version(wrong)
