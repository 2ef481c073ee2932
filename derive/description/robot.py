"""A robot in symbols: what a description means, and what the derivation starts from."""

from dataclasses import dataclass

import sympy as sp
from sympy import Expr, Symbol

from ..algebra.constants import Constants
from .reader import Reader, symbol

Point2 = tuple[Expr, Expr]


@dataclass(frozen=True)
class Frame:
    """A rigid frame: the root, or hung at `at` of its parent and turned by `angle`."""

    name: str
    parent: str | None
    at: Point2  # the root: its position in the plane [m]
    angle: Expr  # the root: its heading; else the angle from the parent [rad]
    limits: Point2 | None = None  # of the angle [rad]


@dataclass(frozen=True)
class Body:
    """A mass fixed to a frame at `at`; inertia about its own centre."""

    frame: str
    at: Point2
    mass: Expr
    inertia: Expr


@dataclass(frozen=True)
class Wheel(Body):
    """A wheel: a mass that also spins about its axle and touches the ground."""

    name: str
    radius: Expr
    heading: Expr
    roller_angle: Expr | None  # from the heading to the rollers' axles; None for a conventional wheel [rad]
    spin_inertia: Expr

    @property
    def is_conventional(self) -> bool:
        """Whether it has no rollers and so does not slip sideways."""
        return self.roller_angle is None


@dataclass(frozen=True)
class Motor:
    input: str
    wheel: str | None
    joint: str | None
    torque_gain: Expr  # [N m/V], or 1 if the input is the torque itself
    back_emf: Expr
    unit: str  # of the input: V or N m


@dataclass(frozen=True)
class Robot:
    """A robot in symbols: everything that the derivation starts from."""

    name: str
    title: str
    source: str
    units: dict[str, str]
    coordinates: tuple[Symbol, ...]
    parameters: tuple[Symbol, ...]
    defaults: dict[Symbol, sp.Rational]
    about: dict[str, str]
    known: frozenset[Symbol]
    frames: tuple[Frame, ...]  # parents first
    bodies: tuple[Body, ...]
    wheels: tuple[Wheel, ...]
    motors: tuple[Motor, ...]
    constraints: tuple[dict[Symbol, Expr], ...]  # coefficients of the rates
    pseudo_velocities: dict[Symbol, dict[Symbol, Expr]] | None
    outputs: dict[str, Expr]  # empty if the model alone is wanted
    constants: Constants  # angles that are written as decimals
    reader: Reader

    @property
    def numbers(self) -> dict[Symbol, Expr]:
        """The values of parameters, by default, and of constants."""
        return {**self.defaults, **self.constants.values}

    def rate(self, coordinate: Symbol) -> Symbol:
        return symbol(f"{coordinate.name}_dot")
