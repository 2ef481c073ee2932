"""A mechanism as MuJoCo's XML: rolling is told nowhere, it follows from friction at contacts.

root       slides in x and y and turns about the vertical, without gravity: nothing tips
joint      a hinge about the vertical; joints that follow one coordinate are coupled
wheel      hangs on a slide, which a preloaded spring presses onto the floor, and turns about its axle
             conventional  a sphere: one contact point, turning on the spot costs nothing
             Swedish       a capsule along the rollers' axles, whose friction is free along them: the frame of a
                           contact between plane and capsule turns with the capsule
motor      torque = gain u - back_emf rate on the hinge

In space the root may also rise, pitch and roll, all is heavy, and wheels hang on no slides: their loads follow.

The load of a wheel does not enter the planar motion as long as nothing slips. Spin inertia that a thin disc of the
wheel's mass cannot have is the rotor's (`armature`).
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from typing import Any

import numpy as np

from wmr_afl.model.wheel_loads import GRAVITY
from wmr_afl.numerics.arrays import Floats
from wmr_afl.validation.mechanism import Mechanism, Wheel

PLANAR = ("x", "slide", "1 0 0"), ("y", "slide", "0 1 0"), ("heading", "hinge", "0 0 1")
UPRIGHT = ("z", "slide", "0 0 1"), ("pitch", "hinge", "0 1 0"), ("roll", "hinge", "1 0 0")
SAG = 0.05  # [m], of the spring that presses a wheel down
LOAD_INERTIA = 30.0  # of a slide, times load/g: it hardly moves
FREE = 1e-5  # friction along rollers; MuJoCo takes no less
HALF = 1e-7  # half length of a Swedish wheel's capsule, in radii
AMPLE, AMPLE_FOR_ROLLERS = 50.0, 5.0  # friction
OF_WHEELS = 0.9  # of a wheel's mass and inertia that hang on it; the rest stays at the frame, so that none is empty
DISC = 1.9  # times its inertia about a diameter, that a disc has about its axle at most


@dataclass(frozen=True)
class Contact:
    """How hard contacts are, and how exactly they are solved."""

    step: float = 1e-3  # [s]
    friction: float = 2.0  # ample, so that nothing slips; what is needed is told
    slow: float = 0.0  # [s], time constant of the vertical; that of friction unless given
    light: float = 1e-5  # of the robot's mass, for what the description leaves without any
    stiffness: float = 0.95  # MuJoCo's impedance; above 0.99 the loads of Swedish wheels chatter


def ample_friction(mechanism: Mechanism) -> float:
    """So much that hardly anything slips; with more of it rollers rub, too."""
    return AMPLE_FOR_ROLLERS if mechanism.has_rollers else AMPLE


@dataclass(frozen=True)
class Rest:
    """What a frame weighs without its wheels."""

    mass: float
    centre: Floats  # (2,) [m]
    inertia: float  # about the centre


def xml_of(mechanism: Mechanism, loads: Floats, contact: Contact, height: float | None = None) -> str:
    """The whole model; `loads` (wheels,) [N]. In space with all masses at `height` [m] above the floor, else planar."""
    root = ET.Element("mujoco", model=mechanism.model.name)
    ET.SubElement(root, "compiler", angle="radian", balanceinertia="false", inertiafromgeom="false")
    ET.SubElement(
        root, "option", timestep=_text(contact.step), integrator="Euler", cone="elliptic", solver="Newton",
        iterations="100", tolerance="1e-14", gravity=_text(0, 0, 0 if height is None else -GRAVITY),
    )  # fmt: skip
    _look(root)
    hard = _text(2.0 * contact.step)
    default = ET.SubElement(root, "default")
    ET.SubElement(default, "geom", contype="0", conaffinity="0")
    impedance = f"{contact.stiffness} {contact.stiffness} 0.001"
    ET.SubElement(
        default, "pair", solref=f"{_text(contact.slow) if contact.slow else hard} 1", solreffriction=f"{hard} 1",
        solimp=impedance, condim="3",
    )  # fmt: skip
    world = ET.SubElement(root, "worldbody")
    ET.SubElement(world, "light", pos="0 0 20", dir="0 0 -1", directional="true", diffuse=".4 .4 .4", specular="0 0 0")
    ET.SubElement(world, "geom", name="floor", type="plane", size="0 0 .1", material="grid")
    bodies: dict[str | None, ET.Element] = {None: world}
    for frame in mechanism.frames:
        bodies[frame.name] = _frame(bodies[frame.parent], mechanism, frame.name, contact, height)
    pairs = ET.SubElement(root, "contact")
    for wheel, load in zip(mechanism.wheels, loads, strict=True):
        _wheel(bodies[wheel.frame], wheel, None if height is not None else float(load), mechanism, contact)
        across = contact.friction if wheel.roller_angle is None else FREE
        friction = _text(across, contact.friction, 0, 0, 0)
        ET.SubElement(pairs, "pair", geom1="floor", geom2=wheel.name, friction=friction)
    equality = ET.SubElement(root, "equality")
    for joint, (other, offset, slope) in mechanism.couplings.items():
        polynomial = _text(offset, slope, 0, 0, 0)
        ET.SubElement(
            equality, "joint", joint1=joint, joint2=other, polycoef=polynomial, solref=f"{hard} 1", solimp=impedance
        )
    _motors(ET.SubElement(root, "actuator"), mechanism)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _frame(parent: ET.Element, mechanism: Mechanism, name: str, contact: Contact, height: float | None) -> ET.Element:
    frame = next(one for one in mechanism.frames if one.name == name)
    place: dict[str, Any] = {"pos": _text(*frame.at, 0)}
    if frame.parent is not None and not frame.is_joint:
        place["euler"] = _text(0, 0, mechanism.fixed_angle(name))
    body = ET.SubElement(parent, "body", name=name, **place)
    if frame.parent is None:
        for joint, kind, axis in PLANAR if height is None else (*PLANAR, *UPRIGHT):
            ET.SubElement(body, "joint", name=f"root {joint}", type=kind, axis=axis)
    elif frame.is_joint:
        ET.SubElement(body, "joint", name=name, type="hinge", axis="0 0 1")
    rest, radius = rest_of(mechanism, name, contact), mechanism.wheels[0].radius
    centre = _text(*rest.centre, radius if height is None else height)
    ET.SubElement(body, "inertial", pos=centre, mass=_text(rest.mass), diaginertia=_text(*[rest.inertia] * 3))
    _box(body, mechanism, name, radius)
    return body


def rest_of(mechanism: Mechanism, name: str, contact: Contact) -> Rest:
    """A frame with its bodies, less what hangs on its wheels: mass, first moment and inertia of all remain exact."""
    mass, moment, inertia = 0.0, np.zeros(2), 0.0
    for part in (*mechanism.bodies, *mechanism.wheels):
        if part.frame == name:
            mass, moment = mass + part.mass, moment + part.mass * part.at
            inertia += part.inertia + part.mass * float(part.at @ part.at)
    for wheel in mechanism.wheels:
        if wheel.frame == name:
            own, around = hung(wheel, mechanism, contact)
            mass, moment = mass - own, moment - own * wheel.at
            inertia -= around + own * float(wheel.at @ wheel.at)
    places = [*(wheel.at for wheel in mechanism.wheels), *(frame.at for frame in mechanism.frames)]
    size = max(float(np.hypot(*at)) for at in places) + mechanism.wheels[0].radius
    mass = max(mass, contact.light * mechanism.mass)
    centre = moment / mass
    inertia -= mass * float(centre @ centre)
    return Rest(mass, centre, max(inertia, 1e-2 * contact.light * mechanism.mass * size**2))


def hung(wheel: Wheel, mechanism: Mechanism, contact: Contact) -> tuple[float, float]:
    """Mass and inertia about a diameter of what hangs on a wheel."""
    mass = OF_WHEELS * wheel.mass or contact.light * mechanism.mass
    return mass, OF_WHEELS * wheel.inertia or 1e-3 * mass * wheel.radius**2


def _wheel(parent: ET.Element, wheel: Wheel, load: float | None, mechanism: Mechanism, contact: Contact) -> None:
    turned = 0.0 if wheel.roller_angle is None else wheel.roller_angle
    mass, inertia = hung(wheel, mechanism, contact)
    spin = wheel.spin_inertia / np.cos(turned) ** 2  # of the wheel that rolls across the rollers' axles
    spin = spin or contact.light * mechanism.mass * wheel.radius**2
    disc = min(0.999 * spin, DISC * inertia)
    body = ET.SubElement(
        parent, "body", name=f"{wheel.name} wheel", pos=_text(*wheel.at, wheel.radius),
        euler=_text(0, 0, wheel.angle + turned),
    )  # fmt: skip
    if load is not None:
        ET.SubElement(
            body, "joint", name=f"{wheel.name} load", type="slide", axis="0 0 1", stiffness=_text(load / SAG),
            springref=_text(-SAG), armature=_text(LOAD_INERTIA * load / GRAVITY),
        )  # fmt: skip
    ET.SubElement(body, "joint", name=f"{wheel.name} spin", type="hinge", axis="0 1 0", armature=_text(spin - disc))
    ET.SubElement(body, "inertial", pos="0 0 0", mass=_text(mass), diaginertia=_text(inertia, disc, inertia))
    shape: dict[str, Any] = {"type": "sphere", "size": _text(wheel.radius)}
    if wheel.roller_angle is not None:
        shape = {
            "type": "capsule",
            "size": _text(wheel.radius, HALF * wheel.radius),
            "euler": _text(0.5 * np.pi, 0, 0),
        }
    ET.SubElement(body, "geom", name=wheel.name, group="3", **shape)
    _disc(parent if wheel.roller_angle is not None else body, wheel)


def _motors(actuators: ET.Element, mechanism: Mechanism) -> None:
    wheels = {wheel.name: wheel for wheel in mechanism.wheels}
    for motor in mechanism.motors:
        wheel = wheels.get(motor.drives)
        joint = motor.drives if wheel is None else f"{wheel.name} spin"
        gear = 1.0 if wheel is None or wheel.roller_angle is None else 1.0 / np.cos(wheel.roller_angle)
        ET.SubElement(
            actuators, "general", name=motor.name, joint=joint, gear=_text(gear), biastype="affine",
            gainprm=_text(motor.gain), biasprm=_text(0, 0, -motor.back_emf),
        )  # fmt: skip


def _look(root: ET.Element) -> None:
    visual = ET.SubElement(root, "visual")
    ET.SubElement(visual, "global", offwidth="1280", offheight="720")
    ET.SubElement(visual, "headlight", ambient=".25 .25 .25", diffuse=".3 .3 .3", specular="0 0 0")
    ET.SubElement(visual, "map", zfar="200")
    asset = ET.SubElement(root, "asset")
    ET.SubElement(
        asset, "texture", name="grid", type="2d", builtin="checker", rgb1=".8 .82 .85", rgb2=".62 .65 .7", width="256",
        height="256",
    )  # fmt: skip
    ET.SubElement(asset, "material", name="grid", texture="grid", texrepeat="1 1", texuniform="true")


def _box(body: ET.Element, mechanism: Mechanism, name: str, height: float) -> None:
    """A plate over all that a frame holds."""
    parts = [part.at for part in (*mechanism.wheels, *mechanism.bodies) if part.frame == name]
    parts += [frame.at for frame in mechanism.frames if frame.parent == name]
    points = np.array([np.zeros(2), *parts])
    low, high = points.min(axis=0), points.max(axis=0)
    half = np.maximum(0.5 * (high - low), 0.35 * height)
    ET.SubElement(
        body, "geom", type="box", pos=_text(*(0.5 * (low + high)), 1.3 * height), size=_text(*half, 0.12 * height),
        rgba=".75 .3 .2 .55", group="1", mass="0",
    )  # fmt: skip


def _disc(body: ET.Element, wheel: Wheel) -> None:
    """A wheel as one sees it; that of a Swedish one does not turn with its contact."""
    is_own = wheel.roller_angle is None
    place: dict[str, Any] = {"pos": "0 0 0", "euler": _text(0.5 * np.pi, 0, 0)}
    if not is_own:
        place = {"pos": _text(*wheel.at, wheel.radius), "euler": _text(0.5 * np.pi, 0, wheel.angle)}
    ET.SubElement(
        body, "geom", type="cylinder", size=_text(0.985 * wheel.radius, 0.22 * wheel.radius), group="1", mass="0",
        rgba=".15 .15 .17 1" if is_own else ".1 .35 .6 1", **place,
    )  # fmt: skip
    if is_own:
        size = _text(0.8 * wheel.radius, 0.23 * wheel.radius, 0.06 * wheel.radius)
        ET.SubElement(body, "geom", type="box", size=size, rgba=".8 .8 .2 1", group="1", mass="0")


def _text(*numbers: float) -> str:
    return " ".join(f"{number:.15g}" for number in numbers)
