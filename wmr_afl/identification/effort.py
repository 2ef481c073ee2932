"""The robot as a log sees it: R diag(rho) u = Y(x, a, c) pi + R diag(rho) F(x) of friction, linear in what is unknown.

    unknown = [pi; rho; kappa]      base parameters, ratios of gains, Coulomb friction in volts of the first motor
    R_1 u_1 = Y pi - sum_k rho_k R_k u_k + sum_g kappa_g R_g tanh(rate/epsilon)           (I1), (I3) times X^T, (I5)
    a = M^-1 (R diag(rho) u - Y_0 pi - R F kappa),     M = [Y_1 pi ... Y_(n-m) pi]        (I4)

Y_0 = Y at a = 0, Y_i = Y at the i-th unit of a, less Y_0 (I2). The friction of a motor whose gain is rho times that of
the first one is kappa/rho of its own volts.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from wmr_afl.errors import MissingTermError
from wmr_afl.identification.alike import gain_kinds, is_geometry, motor_kinds
from wmr_afl.identification.log import Channel
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.complementarity import stopping_forces
from wmr_afl.numerics.linear_algebra import solve

FRICTION_WIDTH = 0.1  # [rad/s], over which friction changes its sign where rates are measured: they are coarse
SLIGHT = 1e-2  # of the inertia of the description: with less there is no motion to speak of
Coulomb = Literal["each", "grouped", "none"]


@dataclass(frozen=True)
class Effort:
    """A model with its geometry, and how its motors rub: each by itself, equal ones alike, or none."""

    model: Model
    p: Floats  # (n_p,), of which only lengths in S and X and known constants are read
    coulomb: Coulomb = "grouped"
    given: frozenset[str] = frozenset()  # parameters that are known besides geometry
    built: dict[tuple[float, float], ca.Function] = field(
        default_factory=dict, repr=False
    )  # by `Simulated`, to be kept

    def __post_init__(self) -> None:
        if not self.model.has("effort_regressor"):
            obstacle = str(self.model.metadata["effort_obstacle"])
            raise MissingTermError(f"{self.model.name} cannot be identified: {obstacle}", "and derive it again")

    @cached_property
    def c(self) -> Floats:
        return self.model.known(self.p)

    @cached_property
    def n(self) -> int:
        """Coordinates."""
        return self.model.coordinate_count

    @cached_property
    def n_v(self) -> int:
        """Pseudo-velocities."""
        return self.model.pseudo_velocity_count

    @cached_property
    def friction_groups(self) -> dict[str, list[int]]:
        """Name -> motors that rub alike."""
        names = list(self.model.input_units)
        each = [[j] for j in range(len(names))]
        groups = {"each": each, "grouped": motor_kinds(self.model), "none": []}[self.coulomb]
        return {f"coulomb_{names[group[0]]}": group for group in groups}

    @cached_property
    def ratio_groups(self) -> dict[str, list[int]]:
        """Name -> motors whose gain is that many times the first one's."""
        names = list(self.model.input_units)
        return {f"gain_ratio_{names[group[0]]}": group for group in gain_kinds(self.model)}

    @cached_property
    def units(self) -> dict[str, str]:
        """Of what is unknown, by name, in its order."""
        return {
            **self.model.metadata["effort_parameters"],
            **dict.fromkeys(self.ratio_groups, "1"),
            **dict.fromkeys(self.friction_groups, "V"),
        }

    @cached_property
    def formulas(self) -> dict[str, str]:
        """Of what is unknown, by name: a formula of physical parameters, or words for friction."""
        motors, ratios = list(self.model.input_units), self.model.metadata["gain_ratio_formulas"]
        return {
            **self.model.metadata["effort_parameter_formulas"],
            **{name: ratios[motors[group[0]]] for name, group in self.ratio_groups.items()},
            **{
                name: f"Coulomb friction of {', '.join(motors[j] for j in group)}"
                for name, group in self.friction_groups.items()
            },
        }

    @cached_property
    def n_pi(self) -> int:
        """Base parameters without ratios and friction."""
        return len(self.model.metadata["effort_parameters"])

    def base(self, p: Floats) -> Floats:
        """[pi; rho] of a robot with these parameters."""
        first = [group[0] for group in self.ratio_groups.values()]
        return np.concatenate([np.asarray(self.model.effort_parameters(p)), self.ratios(p)[first]])

    def ratios(self, p: Floats) -> Floats:
        """rho (n_u,) of a robot with these parameters."""
        return np.asarray(self.model.gain_ratios(p)) if self.model.has("gain_ratios") else np.ones(self.n_u)

    @cached_property
    def n_u(self) -> int:
        """Motors."""
        return len(self.model.input_units)

    def kinematic(self, q: Floats) -> Floats:
        """S (..., n, n-m)."""
        return np.asarray(self.model.kinematic_matrix(q, self.p))

    def motor_rates(self, q: Floats) -> Floats:
        """X (..., n_u, n-m)."""
        return np.asarray(self.model.actuator_rates_matrix(q, self.p))

    def rates(self, x: Floats) -> Floats:
        """X v (T, n_u) [rad/s]."""
        return np.asarray(np.einsum("tij,tj->ti", self.motor_rates(x[:, : self.n]), x[:, self.n :]))

    def map(self, q: Floats) -> Floats:
        """R (..., n-m, n_u)."""
        return np.asarray(self.model.effort_map(q, self.c))

    @cached_property
    def _symbols(self) -> _Symbols:
        """Everything in symbols of one sample."""
        model, c = self.model.in_library("casadi"), ca.DM(self.c)
        x, u = ca.SX.sym("x", self.n + self.n_v), ca.SX.sym("u", len(self.model.input_units))
        q, v = x[: self.n], x[self.n :]
        r, x_of_v = model.effort_map(q, c), ca.SX(model.actuator_rates_matrix(q, self.p))
        rates = x_of_v @ v
        y0 = model.effort_regressor(x, ca.DM.zeros(self.n_v), c)
        y = [model.effort_regressor(x, ca.DM.eye(self.n_v)[:, i], c) - y0 for i in range(self.n_v)]
        ratios = [motor for group in self.ratio_groups.values() for motor in group]
        first = [j for j in range(u.numel()) if j not in ratios]
        rubbing = r @ ca.diag(ca.tanh(rates / FRICTION_WIDTH))
        return _Symbols(
            x=x,
            u=u,
            x_of_v=x_of_v,
            q_rate=model.kinematic_matrix(q, self.p) @ v,
            rates=rates,
            y0=y0,
            y=y,
            first=r[:, first] @ u[first],
            others=ca.horzcat(ca.DM.zeros(self.n_v, 0), *(r[:, g] @ u[g] for g in self.ratio_groups.values())),
            friction=ca.horzcat(
                ca.DM.zeros(self.n_v, 0), *(_row_sums(rubbing, g) for g in self.friction_groups.values())
            ),
        )

    @cached_property
    def columns(self) -> ca.Function:
        """(x, u, a) -> what each unknown number is multiplied by: [Y, -R_k u_k, R F] (n-m, unknown)."""
        s, a = self._symbols, ca.SX.sym("a", self.n_v)
        y = s.y0 + sum(one * a[i] for i, one in enumerate(s.y))
        return ca.Function("columns", [s.x, s.u, a], [ca.densify(ca.horzcat(y, -s.others, s.friction))])

    @cached_property
    def weak_terms(self) -> ca.Function:
        """(x, u) -> what psi multiplies, what psi' multiplies (n-m, unknown each), R_1 u_1 and X v (I7)."""
        s = self._symbols
        q, v = s.x[: self.n], s.x[self.n :]
        held = [ca.reshape(ca.jtimes(ca.vec(one), q, s.q_rate), *one.shape) for one in s.y]  # dY_i/dt
        rest = s.y0 - sum(rate * v[i] for i, rate in enumerate(held))
        momentum = sum(one * v[i] for i, one in enumerate(s.y))
        others = ca.SX.zeros(self.n_v, len(self.units) - self.n_pi)
        a, b = ca.horzcat(rest, -s.others, s.friction), ca.horzcat(momentum, others)
        return ca.Function("weak_terms", [s.x, s.u], [a, b, s.first, s.rates])

    @cached_property
    def motion(self) -> ca.Function:
        """(x, u, unknown, friction) -> q', v' (I4) and the motors' rates X v; friction (n_u,) is in volts."""
        s, unknown = self._symbols, ca.SX.sym("unknown", len(self.units))
        friction = ca.SX.sym("friction", len(self.model.input_units))
        v_rate = self._acceleration(unknown, friction)
        return ca.Function("motion", [s.x, s.u, unknown, friction], [s.q_rate, v_rate, s.rates])

    @cached_property
    def holding(self) -> ca.Function:
        """(x, u, unknown, step) -> friction (n_u,) of the first motor's volts, which stops what it can within a step.

        The law of `Plant`: it opposes each motor's rate with all it has, or holds the motor at rest. A motor that
        passes through rest within the step is opposed one way and then the other: on average by less. Without that
        its rate would be off by a tenth of what it was before, or more.
        """
        s, unknown, step = self._symbols, ca.SX.sym("unknown", len(self.units)), ca.SX.sym("step")
        arrays, count = self.model.in_library("casadi").arrays, len(self.model.input_units)
        most = ca.SX.zeros(count)
        for k, group in enumerate(self.friction_groups.values()):
            most[group] = ca.fabs(unknown[len(self.units) - len(self.friction_groups) + k])
        q = s.x[: self.n]
        free = s.rates + step * (s.x_of_v @ self._acceleration(unknown, ca.SX.zeros(count)))
        inertia = self._inertia(unknown)
        r = self.model.in_library("casadi").effort_map(q, ca.DM(self.c))
        answers = [s.x_of_v @ solve(inertia, r[:, j], arrays) for j in range(count)]
        effects = [[step * answers[j][i] for j in range(count)] for i in range(count)]
        each = [most[j] for j in range(count)]
        held = stopping_forces([free[j] for j in range(count)], effects, [-one for one in each], each, arrays)
        for j in range(count):
            others = sum((effects[j][i] * held[i] for i in range(count) if i != j), start=ca.SX(0))
            way = ca.sign(s.rates[j])
            slowing = way * (s.rates[j] - free[j] + others)  # of its rate within the step, without its own friction
            own = effects[j][j] * each[j]
            passes = ca.logic_and(slowing > own, ca.fabs(s.rates[j]) < slowing + own)
            average = way * each[j] * (2.0 * ca.fabs(s.rates[j]) / (slowing + own) - 1.0)
            held[j] = ca.if_else(passes, average, held[j])
        return ca.Function("holding", [s.x, s.u, unknown, step], [ca.vertcat(*held)])

    def _inertia(self, unknown: ca.SX) -> ca.SX:
        return ca.horzcat(*(one @ unknown[: self.n_pi] for one in self._symbols.y))

    def _acceleration(self, unknown: ca.SX, friction: ca.SX) -> ca.SX:
        """M^-1 (R diag(rho) u - Y_0 pi - R friction)."""
        s, ratios = self._symbols, self.n_pi + len(self.ratio_groups)
        model = self.model.in_library("casadi")
        resisted = model.effort_map(s.x[: self.n], ca.DM(self.c)) @ friction
        push = s.first + s.others @ unknown[self.n_pi : ratios] - s.y0 @ unknown[: self.n_pi] - resisted
        return solve(self._inertia(unknown), push, model.arrays)

    def can_be(self, unknown: Floats, other: Floats, x: Floats) -> bool:
        """Whether every motion has inertia, at states x (T, 2n-m), as a possible robot (`other`) has."""
        every = self.inertia.map(len(x))
        own, possible = (blocks(every(x.T, one), len(x)) for one in (unknown, other))
        with np.errstate(all="ignore"):
            ratios = np.linalg.eigvals(np.linalg.solve(possible, own)).real
        return bool(np.all(ratios > SLIGHT))

    @cached_property
    def inertia(self) -> ca.Function:
        """(x, unknown) -> M = [Y_1 pi ... Y_(n-m) pi] (I4)."""
        unknown = ca.SX.sym("unknown", len(self.units))
        return ca.Function("inertia", [self._symbols.x, unknown], [self._inertia(unknown)])

    @cached_property
    def is_length(self) -> tuple[bool, ...]:
        """Whether a parameter is a length, which may be zero or negative, one entry a parameter."""
        return tuple(unit == "m" for unit in self.model.parameter_units.values())

    @cached_property
    def sought(self) -> tuple[int, ...]:
        """Parameters that a log is asked for: neither lengths in S, X or c, nor given, nor absent (zero)."""
        rows = zip(self.model.parameter_units, is_geometry(self.model, self.p), self.is_length, self.p, strict=True)
        return tuple(
            k
            for k, (name, is_known, is_length, value) in enumerate(rows)
            if not is_known and name not in self.given and (is_length or value != 0.0)
        )

    @cached_property
    def is_free(self) -> NDArray[np.bool_]:
        """Whether a log decides a number (unknown,): base parameters of known ones only are known, too."""
        random, free = np.random.default_rng(0), np.ones(len(self.units), dtype=bool)
        own = self.base(self.p)
        changed = np.zeros(len(own), dtype=bool)
        for _ in range(4):
            p = self.p.copy()
            for k in self.sought:
                p[k] += random.uniform(0.01, 0.1) * (p[k] if p[k] != 0.0 else 1.0)
            changed |= ~np.isclose(self.base(p), own, rtol=1e-12, atol=0.0)
        free[: len(own)] = changed
        return free

    def is_joint(self, one: Channel) -> bool:
        """Whether a channel is a measured angle that the dynamics depend on."""
        return one.matrix == "coordinate" and not one.is_rate and not self.cyclic[one.index]

    @cached_property
    def cyclic(self) -> tuple[bool, ...]:
        """Whether the dynamics are the same at every value of a coordinate (x, y, heading), one entry a coordinate."""
        random = np.random.default_rng(0)
        x, a = random.normal(size=(8, self.n + self.n_v)), random.normal(size=(8, self.n_v))

        def at(x: Floats) -> Floats:
            q = x[:, : self.n]
            parts = (self.model.effort_regressor(x, a, self.c), self.map(q), self.motor_rates(q))
            return np.concatenate([np.asarray(part).ravel() for part in parts])

        def moved(i: int) -> Floats:
            other = x.copy()
            other[:, i] += random.normal(size=len(x))
            return at(other)

        return tuple(bool(np.allclose(moved(i), at(x), rtol=1e-9, atol=1e-12)) for i in range(self.n))


@dataclass(frozen=True)
class _Symbols:
    """The terms of the equation at one state."""

    x: ca.SX
    u: ca.SX
    x_of_v: ca.SX  # X (n_u, n-m)
    q_rate: ca.SX
    rates: ca.SX  # X v (n_u,)
    y0: ca.SX  # (n-m, n_pi)
    y: list[ca.SX]  # Y_i, each (n-m, n_pi)
    first: ca.SX  # R_1 u_1
    others: ca.SX  # R_k u_k, a column each
    friction: ca.SX  # R F, a column for each group


def _row_sums(matrix: ca.SX, columns: list[int]) -> ca.SX:
    return ca.sum2(matrix[:, columns])


def blocks(stacked: ca.DM, count: int) -> Floats:
    """Matrices side by side as `map` gives them, (rows, columns * count) -> (count, rows, columns)."""
    whole = np.asarray(stacked)
    return np.asarray(whole.reshape(len(whole), count, -1).transpose(1, 0, 2))
