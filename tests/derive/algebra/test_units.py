"""Units of expressions are those of the quantities in them."""

from fractions import Fraction
from pathlib import Path

import pytest
import sympy as sp

from derive.algebra.units import MixedUnits, Units, UnknownUnit, format_unit, parse_unit, product
from derive.derivation import derive_robot
from tests.conftest import DESCRIPTIONS
from wmr_input import InputError

m, kg, t, angle, volts, free = sp.symbols("m kg t angle volts free")


@pytest.mark.parametrize(
    ("text", "exponents"),
    [
        ("1", {}),
        ("-", {}),
        ("rad", {}),
        ("", {}),
        ("m", {"m": 1}),
        ("kg m^2", {"kg": 1, "m": 2}),
        ("kg*m^2", {"kg": 1, "m": 2}),
        ("m/s", {"m": 1, "s": -1}),
        ("m/s/s", {"m": 1, "s": -2}),
        ("m/s/kg", {"m": 1, "s": -1, "kg": -1}),
        ("m/s^2", {"m": 1, "s": -2}),
        ("m s^-2", {"m": 1, "s": -2}),
        ("m/s^-2", {"m": 1, "s": 2}),
        ("m/(s kg)", {"m": 1, "s": -1, "kg": -1}),
        ("m/m", {}),
        ("rad/s", {"s": -1}),
        ("N", {"kg": 1, "m": 1, "s": -2}),
        ("J", {"kg": 1, "m": 2, "s": -2}),
        ("W", {"kg": 1, "m": 2, "s": -3}),
        ("Nm", {"kg": 1, "m": 2, "s": -2}),
        ("Hz", {"s": -1}),
        ("N^2", {"kg": 2, "m": 2, "s": -4}),
        ("N m s/rad", {"kg": 1, "m": 2, "s": -1}),
        ("N m/A", {"kg": 1, "m": 2, "s": -2, "A": -1}),
        ("V", {"kg": 1, "m": 2, "s": -3, "A": -1}),
        ("V/Hz", {"kg": 1, "m": 2, "s": -2, "A": -1}),
    ],
)
def test_a_unit_is_read_as_its_exponents(text: str, exponents: dict[str, int]) -> None:
    """Everything behind a stroke stands in the denominator, up to the end."""
    assert parse_unit(text) == exponents


@pytest.mark.parametrize("text", ["mm", "lb", "m^x", "m^1.5", "m^", "N.m", "m^--2"])
def test_what_is_no_unit_is_refused(text: str) -> None:
    """Neither guessed nor left out."""
    with pytest.raises(UnknownUnit):
        parse_unit(text)


@pytest.mark.parametrize(
    ("text", "written"),
    [
        ("kg m/s^2", "N"),
        ("kg m^2/s^2", "N m"),
        ("kg m/s^2/V", "N/V"),
        ("kg m^2/s^2/V", "N m/V"),
        ("kg m^2/s", "N m s"),
        ("rad", "1"),
        ("1/s", "1/s"),
        ("m/s", "m/s"),
        ("s^-1 kg^-1 m", "m/(kg s)"),
        ("m^2 s^3", "m^2 s^3"),
        ("1/s^2", "1/s^2"),
        ("W", "kg m^2/s^3"),
    ],
)
def test_a_unit_is_written_numerator_first(text: str, written: str) -> None:
    """And read back it is the same."""
    assert format_unit(parse_unit(text)) == written
    assert parse_unit(written) == parse_unit(text)


@pytest.fixture
def units() -> Units:
    """Of a length, a mass, a time, an angle and a voltage."""
    return Units({m: parse_unit("m"), kg: parse_unit("kg"), t: parse_unit("s"), angle: {}, volts: parse_unit("V")})


@pytest.mark.parametrize(
    ("expression", "text"),
    [
        (m * kg / t**2, "N"),
        (m + 2 * m, "m"),
        (m + 1, "m"),
        (1 + m * kg, "kg m"),
        (sp.sqrt(m), "m^1/2"),
        (sp.sqrt(m**4), "m^2"),
        (m ** sp.Rational(3, 2), "m^3/2"),
        (1 / sp.sqrt(m), "1/m^1/2"),
        (sp.sqrt(m**2 + m * m), "m"),
        (sp.cbrt(m) ** 2, "m^2/3"),
        (sp.Abs(m / t), "m/s"),
        (sp.sin(angle) * m, "m"),
        (sp.cos(angle) / t, "1/s"),
        (sp.tan(angle), "1"),
        (sp.atan2(m, m) * m, "m"),
        (sp.asin(angle) + sp.acos(angle) + sp.atan(angle), "1"),
        (sp.tanh(angle) / t + sp.sign(m) / t, "1/s"),
        (sp.exp(angle) * volts, "V"),
        (sp.pi * m, "m"),
        (sp.Integer(3), "1"),
        (m**0 + 5, "1"),
        (-m / kg, "m/kg"),
        (free, "?"),
        (free * m, "?"),
        (m + t, "?"),
        (m**kg, "?"),
        (sp.log(m), "?"),
    ],
)
def test_the_unit_of_an_expression_follows_from_its_symbols(units: Units, expression: sp.Expr, text: str) -> None:
    """Roots have fractions of exponents, functions have none; what does not follow is a question mark."""
    assert units.text(expression) == text


def test_adding_a_length_to_a_time_says_which_units_are_mixed(units: Units) -> None:
    """Numbers fit anything."""
    with pytest.raises(MixedUnits, match=r"adds m to s|adds s to m"):
        units.of(m + t)
    assert units.of(3 + m + m) == {"m": Fraction(1)}


def test_named_terms_have_the_units_of_what_they_stand_for() -> None:
    """Declared later they are known, too."""
    speed, energy = sp.symbols("speed energy")
    units = Units({m: parse_unit("m"), t: parse_unit("s"), kg: parse_unit("kg")}, {speed: m / t, energy: kg * speed**2})
    assert units.text(energy / 2) == "N m"
    units.declare(free, parse_unit("V"))
    assert units.of(free * speed) == parse_unit("V m/s")


def test_a_product_of_units_adds_exponents_and_leaves_out_zeros() -> None:
    """first * second^exponent."""
    newton, second = parse_unit("N"), parse_unit("s")
    assert product(newton, second, 2) == {"kg": 1, "m": 1}
    assert product(newton, newton, -1) == {}
    assert product({}, second, Fraction(1, 2)) == {"s": Fraction(1, 2)}


SAME = [
    ("N m/(rad/s)", "N m s"),
    ("N m/(rad/s)", "N m s/rad"),
    ("kg*m**2", "kg m^2"),
    ("kg * m^2", "J s^2"),
    ("V A", "W"),
    ("W", "N m/s"),
    ("Ohm", "V/A"),
    ("V/(rad/s)", "N m/A"),
    ("N m/(A Ohm)", "N m/V"),
    ("1/(s (m/s))", "1/m"),
    ("(kg m)^2/s", "kg^2 m^2/s"),
    ("m/s/s", "m/s^2"),
    ("m/s^-1", "m s"),
]


@pytest.mark.parametrize(("one", "other"), SAME)
def test_units_that_are_the_same(one: str, other: str) -> None:
    assert parse_unit(one) == parse_unit(other)


REFUSED = {
    "mm": "write 'm' and the value times 0.001",
    "deg": "write 'rad' and the value times pi/180",
    "g": "write 'kg' and the value times 0.001",
    "rpm": "write 'rad/s' and the value times pi/30",
    "deg/s": "write 'rad' and the value times pi/180",
    "(m": "parenthesis that is not closed",
    "m)": "')' in unit",
    "m^": "power",
    "^2": "power of nothing",
    "furlong": "use SI units",
}


@pytest.mark.parametrize("text", REFUSED)
def test_what_is_no_si_unit_is_refused_with_what_to_write(text: str) -> None:
    with pytest.raises(UnknownUnit) as caught:
        parse_unit(text)
    assert REFUSED[text] in str(caught.value)


def test_the_back_emf_of_a_motor_follows_from_its_constants(tmp_path: Path) -> None:
    """k_t^2/R is a damping: N m/A and Ohm give N m s."""
    assert format_unit(product(product({}, parse_unit("N m/A"), 2), parse_unit("Ohm"), Fraction(-1))) == "N m s"
    text = DESCRIPTIONS["type_2_0"].read_text()
    text = text.replace("[[frames]]", "\n[[frames]]", 1).replace(
        "[parameters]", '[parameters]\nk_t = { value = 0.1, unit = "N m/A" }\nR = { value = 1.5, unit = "Ohm" }', 1
    )
    text = text.replace('torque_gain = "K1"', 'torque_gain = "k_t/R"').replace(
        'back_emf = "K2"', 'back_emf = "k_t**2/R"'
    )
    path = tmp_path / "robot.toml"
    path.write_text(text)
    derive_robot(path)
    path.write_text(text.replace('back_emf = "k_t**2/R"', 'back_emf = "k_t*R"'))
    with pytest.raises(InputError, match="this place takes N m s/rad"):
        derive_robot(path)
