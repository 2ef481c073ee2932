"""The C of a sampled law: numbers as they are written, and what stands in its header."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from wmr_afl.experiments.load import load_experiment
from wmr_afl.onboard.c_source import LARGEST_FLOAT, SMALLEST_FLOAT, Source, c_name, decimal, digest, in_a_comment
from wmr_afl.onboard.export import onboard
from wmr_afl.onboard.runners import _bits
from wmr_afl.onboard.sampled_law import SampledLaw

LAWS = [("study_1", "AFL", None), ("track_car", "composite", 0.3), ("study_2_pose", "pose", None)]


def read_back(text: str) -> float:
    """A literal in C as a number; a float's has its ending."""
    return float(
        re.sub(r"double|float|[()]|f$", "", text.removesuffix(")")) if text.endswith(")") else text.removesuffix("f")
    )


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("value", [0.0, 1.0, 0.1, 1e22, 5e-324, 1.7976931348623157e308, 123456.0, 2.5e-7, np.pi])
def test_a_double_is_read_back_to_the_bit(value: float, sign: float) -> None:
    text = decimal(sign * value, False)
    assert read_back(text) == sign * value
    assert np.signbit(read_back(text)) == (sign < 0.0)
    assert "." in text or "e" in text  # an integer would be divided as one
    assert not text.rstrip(")").endswith("f")
    assert text.startswith("(") == (sign < 0.0)  # so that no two signs meet


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("value", "kept"),
    [
        (0.0, 0.0), (1.0, 1.0), (0.1, float(np.float32(0.1))), (1e-60, SMALLEST_FLOAT), (1e60, LARGEST_FLOAT),
        (SMALLEST_FLOAT, SMALLEST_FLOAT), (1.3e-38, float(np.float32(1.3e-38))), (LARGEST_FLOAT, LARGEST_FLOAT),
        (3e38, float(np.float32(3e38))),
    ],
)  # fmt: skip
def test_a_float_stays_above_zero_and_finite(value: float, kept: float, sign: float) -> None:
    text = decimal(sign * value, True)
    assert text.strip("()").endswith("f")
    found = float(text.replace("f", "").strip("()"))
    assert np.float32(found) == np.float32(sign * kept)
    assert 0.0 < np.abs(np.float32(found)) < np.inf or value == 0.0
    assert np.signbit(np.float32(found)) == (sign < 0.0)


@pytest.mark.parametrize("value", [1.0 / 3.0, np.pi, 123456.789, 2.0 / 3.0 * 1e-30, 1e60, 1e-60])
def test_a_float_has_nine_digits_at_most(value: float) -> None:
    """The shortest ones that are read back to it; a double has seventeen."""
    for is_single, most in ((True, 9), (False, 17)):
        digits = decimal(value, is_single).partition("e")[0].replace(".", "").strip("f0")
        assert 1 <= len(digits) <= most
        assert digits.isdigit()


def test_what_is_no_finite_number_is_written_by_its_name() -> None:
    for is_single, real in ((False, "double"), (True, "float")):
        found = [re.sub(r"[()]|f$", "", decimal(value, is_single)) for value in (np.inf, -np.inf, np.nan)]
        assert [one.rstrip(")f") for one in found] == [f"{real}INFINITY", f"-{real}INFINITY", f"{real}NAN"]


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("a */ b", "a * / b"),
        ("/* a", "/ * a"),
        ("a\\", "a/"),
        ("a\nb\tc", "a b c"),
        ("??/", "? ?/"),
        ("plain, µ", "plain, µ"),
    ],
)
def test_a_comment_stays_one(text: str, shown: str) -> None:
    assert in_a_comment(text) == shown


def test_names_and_numbers_of_texts() -> None:
    """A number of 32 bits in C that tells two texts apart."""
    assert c_name("friction.coulomb[1]") == "friction_coulomb_1_"
    found = {digest(text) for text in ("", "a", "b", "ab")}
    assert len(found) == 4
    assert all(re.fullmatch(r"0x[0-9a-f]{8}u", one) for one in found)


@cache
def sampled_of(experiment: str, name: str, gate: float | None = None) -> SampledLaw:
    return onboard(load_experiment(experiment).loops[name], gate)


def test_a_setpoint_has_three_fields_with_units_or_a_clock() -> None:
    sampled = sampled_of("study_1", "AFL")
    given, clocked = Source(sampled).setpoint, Source(sampled, takes_clock=True).setpoint
    assert [(name, size) for name, size, _ in given] == [("position", 2), ("velocity", 2), ("acceleration", 2)]
    assert [about for _, _, about in given] == ["yr [m, m]", "yr' [m/s, m/s]", "yr'' [m/s^2, m/s^2]"]
    assert [(name, size) for name, size, _ in clocked] == [("clock", sampled.clock_size)]


@pytest.mark.parametrize(("experiment", "name", "gate"), LAWS)
def test_every_entry_of_every_array_is_told_in_the_header(experiment: str, name: str, gate: float | None) -> None:
    """With unit or formula; what reached the motors stands behind what is measured, if it is told."""
    sampled = sampled_of(experiment, name, gate)
    model, knowledge = sampled.model, sampled.law.knowledge
    formulas = model.formulas_of(knowledge.estimated)
    for is_told in (False, True):
        told = {letter: entries for letter, _, entries in Source(sampled, is_told=is_told).context["indices"]}
        more = [(f"applied_{motor}", "[V]") for motor in model.input_units] if is_told else []
        units = {**dict.fromkeys(model.input_units, "rad/s"), **model.state_units}
        assert [(e.name, e.about) for e in told["X"]] == [(one, f"[{units[one]}]") for one in sampled.measured] + more
    assert [(e.name, e.about) for e in told["U"]] == [(one, "[V]") for one in model.input_units]
    assert [(e.name, e.about) for e in told["Y"]] == [(one, f"[{unit}]") for one, unit in model.output_units.items()]
    entries = told["Z"]
    assert len(entries) == len({e.name for e in entries}) == sampled.states.size
    place = sampled.states.places["theta_hat"]
    assert [(e.name, e.about) for e in entries[place]] == [
        (f"theta_hat_{one}", f"[{unit}] estimate of {one} = {formulas[one]}") for one, unit in knowledge.units.items()
    ]
    for key, where in sampled.states.places.items():
        if key != "theta_hat":
            count = where.stop - where.start
            endings = [f"_{i}" for i in range(count)] if count > 1 else [""]
            assert [e.name for e in entries[where]] == [c_name(key) + ending for ending in endings]


def test_sums_of_small_changes_are_compensated_in_single_precision_only() -> None:
    """Those of laws that adapt: the estimates, one remainder each."""
    adapts, frozen = sampled_of("study_1", "AFL"), sampled_of("study_1", "frozen estimates")
    place = adapts.states.places["theta_hat"]
    assert list(Source(adapts, is_single=True).compensated) == list(range(place.start, place.stop))
    assert Source(adapts, is_single=True).compensated[place.start + 1] == "state->rest[1]"
    assert Source(adapts).compensated == Source(frozen, is_single=True).compensated == {}


@pytest.mark.parametrize(("mask", "bits"), [(0, []), (1, [0]), (2, [1]), (0b1011, [0, 1, 3]), (2**31, [31])])
def test_bits_of_a_mask_are_counted_from_zero(mask: int, bits: list[int]) -> None:
    assert _bits(mask) == bits


def test_a_source_names_what_it_is_asked_to() -> None:
    """Title, origin and prefix; the text of another law is another one."""
    source = replace(Source(sampled_of("study_1", "AFL")), prefix="my", origin="of a test")
    header = source.header()
    assert "of a test" in header
    assert "my_step" in header
    assert "controller_" not in header
    assert "MY_OK" in header
    assert '#include "my.h"' in source.code()
    assert '#include "my.h"' not in source.code(has_header=False)
    assert "same_sample" in source.code(is_called_by_python=True)
    assert "same_sample" not in source.code()
