"""The whole state, and what nobody modelled, from whatever of the state is measured: an extended Kalman filter."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import SimpleNamespace

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.controllers.observer import Observer, Seen
from wmr_afl.controllers.outer_loop import within_half_a_turn
from wmr_afl.model.measurement import Measurement
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Arrays, Floats
from wmr_afl.numerics.covariance import Rows, corrected, from_upper_half, upper_half
from wmr_afl.numerics.linear_algebra import entries, solve
from wmr_afl.numerics.parts import Fault
from wmr_afl.numerics.vectors import by_name, told
from wmr_input.fields import Named

SMALL = 1e-3  # [m, rad], the noise of a coordinate unless told; of rates it is this at the observer's rate
UNKNOWN = 1.0  # [m, rad; m/s, rad/s; m/s^2, rad/s^2], how far off may be at the start what nobody has measured yet


class KalmanObserver(Observer):
    """q^, v^, slip and delta^ of a robot of which z = [entries of q and v; rates of motors X(q) v] is measured.

        q' = S(q) v + G(q) sigma      v' = a + delta      sigma', delta' = white noise                      (3), (10)

    a is what the law expects of the voltages that reach the motors, delta what it does not, sigma slip: G = A(q)^T,
    across wheels, and S(q) beside it if rates are measured, too. y'^ = J_h q'^, d^ = E delta^, and the v^ that a law
    goes by is E^-1 y'^. From sample to sample, T after the last one, F the derivative of the step by the state, Q the
    noise:

        q^ += T (S(q_m) v_m + G(q_m) sigma^)      q_m = q^ + T/2 q'^      v_m = v^ + T/2 a
        v^ += T a                                 P = F P F^T + Q

    and then, one measured entry after the other, h its row and r its noise: i = z - h x^ (angles the shorter way),

        x^ += P h^T i/(h P h^T + r^2)             P -= P h^T h P/(h P h^T + r^2)

    Q = (rate^3 r_q T)^2 of delta puts the poles of a measured coordinate near `rate` [1/s]; r_q is the smallest noise
    of a coordinate, or of a speed over `rate`. Q = (slip_rate^2 r_q T)^2 of sigma, which is zero without `slip_rate`
    [1/s]. Where z says nothing the motion goes on as S tells, as of a coordinate that is carried along. At the first
    sample v^ = sigma^ = delta^ = 0, measured coordinates are as measured, others as `first` says or as before a gap.
    `p` (n_p,): parameters of A, S and X, which are geometry; `deviation` [units of z]. In values and scales of
    batches the noise of a motor's rate is that of the speed it tells, over the length of its row of X.

    Raises:
        WmrError: if a rate or a deviation is not positive.
        UnknownNameError: if `first` names no coordinate.

    References: Kalman filter of a nonlinear system, linearized along its estimate, as in Gelb (ed.), Applied Optimal
    Estimation, MIT Press 1974.
    """

    def __init__(
        self,
        model: Model,
        measurement: Measurement,
        rate: float,
        p: ArrayLike,
        deviation: Named | None = None,
        first: Mapping[str, float] | None = None,
        bound: float = np.inf,
        slip_rate: float | None = None,
    ) -> None:
        self.measurement: Measurement = measurement
        self.rate, self.bound = np.array([float(rate)]), np.array([float(bound)])
        self.n, self.count = model.coordinate_count, model.pseudo_velocity_count
        self.p = np.array(p, dtype=float)
        coordinates = list(model.state_units)[: self.n]
        self.first = by_name("coordinate", dict(first or {}), coordinates, missing=0.0)
        # An encoder is as good as the speed that it tells, whatever the radius of its wheel: noise is kept as of v.
        sizes = np.array(measurement.sizes(self.first, self.p, model))
        self.deviation = np.array(measurement.deviations(deviation, SMALL, SMALL * float(rate) * sizes)) / sizes
        self._inputs = len(model.input_units)
        sees_rates = len(measurement.names) > len(measurement.coordinates)
        self.slip_rate = None if slip_rate is None else np.array([float(slip_rate)])
        constraints = self.n - self.count
        self.slips = 0 if slip_rate is None else constraints + (self.count if sees_rates else 0)
        self.check_numbers()

    @property
    def values(self) -> dict[str, Floats]:
        slip = {} if self.slip_rate is None else {"slip_rate": self.slip_rate}
        return {"rate": self.rate, "bound": self.bound, "deviation": self.deviation, "p": self.p, **slip}

    @property
    def states(self) -> dict[str, Floats]:
        size = self.n + 2 * self.count + self.slips
        state = np.concatenate([self.first, np.zeros(size - self.n)])
        return {
            "state": state,  # [q^; v^; sigma^; delta^]
            "covariance": np.zeros(size * (size + 1) // 2),  # upper half of P, row by row
            "acceleration": np.zeros(self.count),  # a + delta^
            "is_running": np.zeros(1),
        }

    def faults(self, k: SimpleNamespace) -> Iterator[Fault]:
        yield from super().faults(k)
        if self.slip_rate is not None:
            yield (
                ~np.all(np.isfinite(k.slip_rate) & (k.slip_rate > 0), axis=-1),
                lambda k: (f"slip changes at {k.slip_rate[0]:g} /s", "choose a positive number"),
            )
        yield (
            np.any(~(np.isfinite(k.deviation) & (k.deviation > 0)), axis=-1),
            lambda k: (f"the noise of what is measured is {told(k.deviation)}", "choose positive deviations"),
        )

    def see(self, x: Array, z: SimpleNamespace, k: SimpleNamespace, c: Array, model: Model, step: Array) -> Seen:
        """What this sample tells; x is z of the measurement, (len(z),)."""
        arrays, n, count = model.arrays, self.n, self.count
        passed, runs = arrays.where(step > 0.0, step, 1.0), z.is_running[0]
        state, P = self._predicted(z, k, model, passed)
        at_start = self._at_start(x, z)
        state = [runs * a + (1.0 - runs) * b for a, b in zip(state, at_start, strict=True)]
        unknown = (1.0 - runs) * UNKNOWN * UNKNOWN
        P = [[runs * entry + (unknown if i == j else 0.0) for j, entry in enumerate(row)] for i, row in enumerate(P)]
        surprise, coordinates = 0.0, self.measurement.coordinates.values()
        rows = self.measurement.rows(arrays.vector(state[:n]), k.p, model)
        for m, row in enumerate(rows):
            innovation = x[m] - sum(weight * state[i] for i, weight in row.items())
            if self.measurement.is_angle[m]:
                innovation = within_half_a_turn(innovation, arrays)
            size = 1.0 if self.measurement.is_state(m) else sum(weight * weight for weight in row.values())  # squared
            state, P = corrected(state, P, row, innovation, k.deviation[m] * k.deviation[m] * size)
            if m in coordinates:
                surprise = arrays.maximum(surprise, arrays.absolute(innovation))
        q, delta = arrays.vector(state[:n]), arrays.vector(state[len(state) - count :])
        E, J, S = model.output_map(q, c), model.output_jacobian(q, c), model.kinematic_matrix(q, k.p)
        q_rate = S @ arrays.vector(state[n : n + count])
        if self.slips:
            q_rate = q_rate + self._slip_map(q, S, k, model) @ arrays.vector(state[n + count : n + count + self.slips])
        y_rate = J @ q_rate
        v = solve(E, y_rate, arrays) if self.slips else arrays.vector(state[n : n + count])
        memory = {"state": arrays.vector(state), "covariance": arrays.vector(upper_half(P))}
        return Seen(arrays.join([q, v]), model.output(q, c), y_rate, E @ delta, E, runs * surprise, memory)

    def _slip_map(self, q: Array, S: Array, k: SimpleNamespace, model: Model) -> Array:
        """G (n, slips): where slip moves q, sideways as A^T says, and along S where rates are measured, too."""
        A = entries(model.constraint_matrix(q, k.p)) if self.n > self.count else []
        along = entries(S) if self.slips > len(A) else [[] for _ in range(self.n)]
        return model.arrays.matrix([[row[i] for row in A] + list(along[i]) for i in range(self.n)])

    def _predicted(self, z: SimpleNamespace, k: SimpleNamespace, model: Model, step: Array) -> tuple[list[Array], Rows]:
        """[q^; v^; sigma^; delta^] and P one step after the last sample."""
        arrays, n, count, slips = model.arrays, self.n, self.count, self.slips
        size = n + 2 * count + slips
        q, v = z.state[:n], z.state[n : n + count]
        v_mid = v + 0.5 * step * z.acceleration
        q_rate, sigma = model.kinematic_matrix(q, k.p) @ v, z.state[n + count : n + count + slips]
        if slips:
            q_rate = q_rate + self._slip_map(q, model.kinematic_matrix(q, k.p), k, model) @ sigma
        q_mid = q + 0.5 * step * q_rate
        zero = arrays.vector([0.0] * self._inputs), arrays.vector([0.0] * count)
        by_x = model.state_jacobian(arrays.join([q_mid, v_mid]), *zero, k.p)  # its upper rows: of S v by q and by v
        S = [[by_x[i, n + j] for j in range(count)] for i in range(n)]
        q_rate = arrays.matrix(S) @ v_mid
        G: Rows = [[] for _ in range(n)]
        if slips:
            G = entries(self._slip_map(q_mid, arrays.matrix(S), k, model))
            q_rate = q_rate + arrays.matrix(G) @ sigma
        moved = [q[i] + step * q_rate[i] for i in range(n)]
        moved += [v[j] + step * z.acceleration[j] for j in range(count)]
        moved += [z.state[i] for i in range(n + count, size)]
        F: Rows = [[1.0 if i == j else 0.0 for j in range(size)] for i in range(size)]
        for i in range(n):
            for j in range(n):
                F[i][j] = F[i][j] + step * by_x[i, j]
            for j in range(count):
                F[i][n + j] = step * S[i][j]
                F[i][n + count + slips + j] = 0.5 * step * step * S[i][j]
            for j in range(slips):
                F[i][n + count + j] = step * G[i][j]
        for j in range(count):
            F[n + j][n + count + slips + j] = step
        matrix = arrays.matrix(F)
        P = entries(matrix @ arrays.matrix(from_upper_half(z.covariance, size)) @ matrix.T)
        rate, finest = k.rate[0], k.deviation[self._finest]
        if self._finest not in self.measurement.coordinates.values():
            finest = finest / rate
        noise = (rate * rate * rate * finest * step) ** 2
        for j in range(n + count + slips, size):
            P[j][j] = P[j][j] + noise
        for j in range(n + count, n + count + slips):
            P[j][j] = P[j][j] + (k.slip_rate[0] * k.slip_rate[0] * finest * step) ** 2
        return moved, P

    @property
    def _finest(self) -> int:
        """The entry of z with the least noise, that of a rate over the observer's rate."""
        coordinates = self.measurement.coordinates.values()
        scaled = [r if m in coordinates else r / self.rate[0] for m, r in enumerate(self.deviation)]
        return int(np.argmin(scaled))

    def _at_start(self, x: Array, z: SimpleNamespace) -> list[Array]:
        """[q^; v^; sigma^; delta^] before the first sample is taken in."""
        places = self.measurement.coordinates
        q = [x[places[i]] if i in places else z.state[i] for i in range(self.n)]
        return q + [0.0] * (2 * self.count + self.slips)

    def update(self, seen: Seen, acceleration: Array, drift: Array, arrays: Arrays) -> dict[str, Array]:
        return {
            **seen.memory,
            "acceleration": solve(seen.E, acceleration - drift, arrays),
            "is_running": arrays.vector([1.0]),
        }
