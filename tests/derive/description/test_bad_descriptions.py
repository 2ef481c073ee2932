"""Every mistake in a description is told in one line with file, place and remedy."""

from pathlib import Path

import pytest

from derive.derivation import derive_robot
from tests.conftest import DESCRIPTIONS
from wmr_input import InputError

GOOD = DESCRIPTIONS["type_2_0"].read_text()

# (what is replaced, by what, words that the message must hold)
MISTAKES = {
    "unknown key": ('heading = "phi"', 'heading = "phi"\ncolour = "red"', ["'platform'", "colour", "unknown key"]),
    "unknown key, nearest one": ('radius = "r"\nmass', 'radus = "r"\nmass', ["'right'", "did you mean 'radius'"]),
    "unknown table": ("[outputs]", "[output]", ["output", "did you mean 'outputs'"]),
    "misspelt table": ("[coordinates]", "[coordinate]", ["[coordinate]", "did you mean 'coordinates'"]),
    "missing table": (
        '[outputs]\ny1 = "x + L*cos(phi)"\ny2 = "y + L*sin(phi)"',
        "",
        ["[outputs]: missing", "add outputs, or controller = false"],
    ),
    "missing key": ('radius = "r"\nmass', "mass", ["[[wheels]] 'right'", "missing 'radius'"]),
    "not TOML": ('name = "type_2_0"', "name = type_2_0", ["not valid TOML", "line 3"]),
    "wrong type": ('at = ["d", "0"]', 'at = "d"', ["[[bodies]] number 1 at", "expected a list"]),
    "duplicate key": ('phi = "rad" ', 'x = "rad" ', ["not valid TOML"]),
    "unknown name": ('heading = "phi"', 'heading = "phii"', ["'platform' heading", "'phii'", "did you mean 'phi'"]),
    "coordinate where parameters are wanted": ('mass = "m_C"', 'mass = "m_C*x"', ["[[bodies]]", "mass", "'x'"]),
    "unknown frame": ('frame = "platform"\nat = ["d"', 'frame = "platfrm"\nat = ["d"', ["did you mean 'platform'"]),
    "wrong dimension": ('at = ["d", "0"]', 'at = ["d", "0", "0"]', ["at", "3 entries", "give 2"]),
    "constraint not linear in the rates": (
        "[pseudo_velocities]",
        '[[constraints]]\nexpression = "x_dot**2"\n[pseudo_velocities]',
        ["[[constraints]] number 1", "not linear"],
    ),
    "constraint without rates": (
        "[pseudo_velocities]",
        '[[constraints]]\nexpression = "x + y"\n[pseudo_velocities]',
        ["[[constraints]]", "without a rate"],
    ),
    "constraint with a constant part": (
        "[pseudo_velocities]",
        '[[constraints]]\nexpression = "x_dot - 1"\n[pseudo_velocities]',
        ["[[constraints]]", "without a rate"],
    ),
    "wheels cannot roll": (
        '[[motors]]\ninput = "u_r"',
        '[[wheels]]\nname = "blocked"\nframe = "platform"\nat = ["1", "0"]\nradius = "r"\n'
        '[[wheels]]\nname = "across"\nframe = "platform"\nat = ["0", "0"]\nradius = "r"\nheading = "pi/2"\n'
        '[[motors]]\ninput = "u_r"',
        ["leave no motion"],
    ),
    "too many pseudo-velocities": ('omega = "phi_dot"', 'omega = "phi_dot"\nlateral = "x_dot"', ["3", "leave 2"]),
    "too few pseudo-velocities": ('omega = "phi_dot"\n', "", ["[pseudo_velocities]", "name 2"]),
    "rank-deficient pseudo-velocities": (
        'omega = "phi_dot"',
        'omega = "2*x_dot*cos(phi) + 2*y_dot*sin(phi)"',
        ["[pseudo_velocities]", "rank is deficient"],
    ),
    "pseudo-velocity that the constraints forbid": (
        'omega = "phi_dot"',
        'omega = "-x_dot*sin(phi) + y_dot*cos(phi)"',
        ["[pseudo_velocities]", "rank is deficient"],
    ),
    "more outputs than pseudo-velocities": (
        'y2 = "y + L*sin(phi)"',
        'y2 = "y + L*sin(phi)"\ny3 = "phi"',
        ["[outputs]", "3 outputs for 2", "keep 2"],
    ),
    "fewer outputs than pseudo-velocities": ('y2 = "y + L*sin(phi)"', "", ["[outputs]", "1 outputs for 2"]),
    "outputs depend on each other": ('y2 = "y + L*sin(phi)"', 'y2 = "2*x + 2*L*cos(phi)"', ["depend on each other"]),
    "output without coordinates": ('y2 = "y + L*sin(phi)"', 'y2 = "2*L"', ["[outputs] y2", "depends on no coordinate"]),
    "no look-ahead": (
        'y1 = "x + L*cos(phi)"\ny2 = "y + L*sin(phi)"',
        'y1 = "x"\ny2 = "y"',
        ["singular everywhere", "omega", "look-ahead"],
    ),
    "fewer motors than pseudo-velocities": (
        '[[motors]]\ninput = "u_l"\ndrives = "left"\ntorque_gain = "K1"\nback_emf = "K2"\n',
        "",
        ["[[motors]]", "1 motors for 2", "add 1"],
    ),
    "motor drives nothing": ('drives = "left"', 'drives = "lft"', ["'u_l' drives", "did you mean 'left'"]),
    "both motors on one wheel": ('drives = "left"', 'drives = "right"', ["act on 1 of 2"]),
    "two roots": (
        "[[bodies]]",
        '[[frames]]\nname = "other"\nposition = ["x", "y"]\nheading = "phi"\n\n[[bodies]]',
        ["one root frame", "'other'"],
    ),
    "frames in a loop": (
        "[[bodies]]",
        '[[frames]]\nname = "a"\nparent = "b"\nat = ["0", "0"]\nangle = "0"\n'
        '[[frames]]\nname = "b"\nparent = "a"\nat = ["0", "0"]\nangle = "0"\n[[bodies]]',
        ["loop", "a -> b -> a"],
    ),
    "frame neither root nor jointed": ('heading = "phi"\n', "", ["'platform'", "position and heading"]),
    "zero radius": ('radius = "r"\nmass', 'radius = "0"\nmass', ["'right' radius", "positive"]),
    "name taken twice": ('omega = "phi_dot"', 'b = "phi_dot"', ["b", "taken in [parameters]"]),
    "name of a function": ('K2 = { value', 'sin = { value = 1.0, unit = "m" }\nK2 = { value', ["'sin'", "reserved"]),
    "name of a rate": (
        "L = { value",
        'x_dot = { value = 1.0, unit = "m" }\nL = { value',
        ["x_dot", "is the rate of the coordinate 'x'"],
    ),
    "value not finite": ("value = 0.15", "value = nan", ["r.value", "finite"]),
    "division by zero": ('y1 = "x + L*cos(phi)"', 'y1 = "x/(L - L)"', ["[outputs] y1", "not a finite real number"]),
    "unknown known constant": ('name = "type_2_0"', 'known = ["l"]\nname = "type_2_0"', ["known", "'L'"]),
    "hostile expression": (
        'heading = "phi"',
        "heading = \"__import__('os').system('true')\"",
        ["'platform' heading", "arithmetic"],
    ),
    "radius that is no length": (
        'radius = "r"\nmass',
        'radius = "K1"\nmass',
        ["'right' radius", "has the unit", "takes m"],
    ),
    "sum of different units": ('at = ["d", "0"]', 'at = ["d + m_C", "0"]', ["[[bodies]]", "at", "mind the units"]),
    "unknown unit": ('unit = "N m/V"', 'unit = "furlong"', ["[parameters] K1", "unknown unit", "furlong"]),
    "negative mass": ("value = 36.0", "value = -36.0", ["[[bodies]]", "mass", "is -36", "must not be negative"]),
    "title of several lines": (
        'title = "Differential drive, type (2,0)"',
        'title = "a\\nb"',
        ["title", "one line"],
    ),
    "hostile power": ('y1 = "x + L*cos(phi)"', 'y1 = "9**9**9"', ["[outputs] y1", "exponent"]),
    "hostile name": ('name = "type_2_0"', 'name = "../../evil"', ["name", "letters"]),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_reported_in_one_line_with_its_place(mistake: str, tmp_path: Path) -> None:
    old, new, words = MISTAKES[mistake]
    assert GOOD.count(old) >= 1, "the test itself must change something"
    path = tmp_path / "robot.toml"
    path.write_text(GOOD.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        derive_robot(path)
    text = str(caught.value)
    assert text.startswith(str(path))
    for word in words:
        assert word in text
    assert len(text.splitlines()) == 1, text


def test_a_motion_without_inertia(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(
        GOOD.replace('mass = "m_C"\ninertia = "I_C"', 'mass = "0"').replace('mass = "m_w"\ninertia = "I_m"', "")
    )
    with pytest.raises(InputError, match=r"\[\[bodies\]\]: some motion has no inertia"):
        derive_robot(path)


@pytest.mark.parametrize("content", [None, b"\xff\xfe", b"", b"[[[["], ids=["no file", "not UTF-8", "empty", "broken"])
def test_a_file_that_is_no_description(content: bytes | None, tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"robot\.toml"):
        derive_robot(path)
