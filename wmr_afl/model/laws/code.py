"""Laws of the generated code: both libraries agree, batches agree with single calls, Jacobians with differences."""

from __future__ import annotations

import numpy as np

from wmr_afl.model.laws.law import Law, Situation, largest, relative
from wmr_afl.numerics.arrays import Floats

_STEPS = tuple(1e-2 / 4.0**k for k in range(7))  # of differences, in units of the state and the input


def _libraries_agree(s: Situation) -> float:
    worst = 0.0
    for name, function in s.casadi.functions().items():
        given = [s.arguments[argument] for argument in function.name_in()]
        batch = getattr(s.numpy, name)(*given)
        single = np.array([function(*row).full() for row in zip(*given, strict=True)])
        worst = largest(worst, _entrywise(single.reshape(batch.shape), batch))
    return worst


def _entrywise(value: Floats, expected: Floats) -> float:
    """Largest difference relative to the entry's own largest size over the batch.

    A small entry that is left by the cancellation of larger ones carries their rounding errors; these do not count.
    """
    if not value.size:
        return 0.0
    size = np.max(np.abs(expected), axis=0)
    rounding = 4.0 * np.finfo(float).eps * float(size.max())
    return float(np.max(np.maximum(np.abs(value - expected) - rounding, 0.0) / np.maximum(size, 1e-300)))


def _batches_agree(s: Situation) -> float:
    """Leading shapes (), (2, 2), (0,), (3, 0) and broadcasting give the same as one call for each row."""
    worst = 0.0
    for name, function in s.casadi.functions().items():
        term = getattr(s.numpy, name)
        given = [s.arguments[argument] for argument in function.name_in()]
        singles = np.array([term(*row) for row in zip(*given, strict=True)])
        worst = largest(worst, relative(term(*given), singles))
        square = term(*(array[:4].reshape(2, 2, array.shape[1]) for array in given))
        worst = largest(worst, relative(square, singles[:4].reshape(2, 2, *singles.shape[1:])))
        for shape in ((0,), (3, 0)):
            empty = term(*(np.zeros((*shape, array.shape[1])) for array in given))
            if empty.shape != (*shape, *singles.shape[1:]):
                return np.inf
        spread = term(given[0][:, None, :], *(array[None, :1, :] for array in given[1:]))
        rows = [term(row, *(array[0] for array in given[1:])) for row in given[0]]
        worst = largest(worst, relative(spread[:, 0], np.array(rows)))
    return worst


def _jacobians_are_derivatives(s: Situation) -> float:
    arguments = (s.x, s.u, s.w, s.p)
    worst = relative(s.numpy.state_jacobian(*arguments), s.jacobian("state_derivative", "x"))
    return largest(worst, relative(s.numpy.input_jacobian(*arguments), s.jacobian("state_derivative", "u")))


def _jacobians_are_differences(s: Situation) -> float:
    """Central differences with Richardson's extrapolation, each state with the step at which they change least.

    Near a singularity a fixed step reaches too far. Which step is right is judged by the differences alone, so that a
    wrong Jacobian still shows. Deviations are relative to the state's own Jacobian.
    """
    worst = 0.0
    for wrt, term in enumerate((s.numpy.state_jacobian, s.numpy.input_jacobian)):
        jacobian = term(s.x, s.u, s.w, s.p)
        if not jacobian.size:
            continue
        difference = np.abs(jacobian - _settled([_differences(s, wrt, step) for step in _STEPS]))
        size = np.maximum(1.0, np.abs(jacobian).max(axis=(1, 2), keepdims=True))
        worst = largest(worst, float(np.max(difference / size)))
    return worst


def _differences(s: Situation, wrt: int, step: float) -> Floats:
    """dx'/dx or dx'/du, (batch, 2n-m, columns), by differences of order 4."""

    def change(step: float) -> Floats:
        given = [s.x, s.u, s.w, s.p]
        columns = []
        for row in np.eye(given[wrt].shape[1]):
            ahead, behind = list(given), list(given)
            ahead[wrt], behind[wrt] = given[wrt] + step * row, given[wrt] - step * row
            columns.append((s.numpy.state_derivative(*ahead) - s.numpy.state_derivative(*behind)) / (2.0 * step))
        return np.stack(columns, axis=-1)

    return (4.0 * change(0.5 * step) - change(step)) / 3.0


def _settled(estimates: list[Floats]) -> Floats:
    """Of every entry the estimate that differs least from the one at the next smaller step."""
    stacked = np.stack(estimates)
    changes = np.abs(np.diff(stacked, axis=0))
    best = np.argmin(np.where(np.isfinite(changes), changes, np.inf), axis=0)
    return np.take_along_axis(stacked[1:], best[None], axis=0)[0]


def _trusted_values(s: Situation) -> float:
    """Every function against its SymPy expression at one point, evaluated to 30 digits when the robot was derived."""
    trusted = s.numpy.trusted_values()
    worst = 0.0
    for name, description in s.numpy.metadata["functions"].items():
        given = [trusted["arguments"][argument] for argument in description["arguments"]]
        expected = np.reshape(np.array(trusted["values"][name], dtype=float), description["size"])
        in_casadi = getattr(s.casadi, name)(*given).full().reshape(expected.shape)
        for value in (getattr(s.numpy, name)(*given), in_casadi):
            worst = largest(worst, _entrywise(value[None], expected[None]))
    return worst


LAWS = (
    Law("trusted values", "every function equals its expression evaluated to 30 digits", 1e-12, _trusted_values),
    Law("libraries agree", "NumPy and CasADi give the same", 1e-12, _libraries_agree),
    Law("batches agree", "batches of any leading shape give what one by one gives", 1e-13, _batches_agree),
    Law("Jacobians", "dx'/dx and dx'/du equal automatic differentiation", 1e-11, _jacobians_are_derivatives),
    Law("differences", "dx'/dx and dx'/du equal finite differences", 1e-8, _jacobians_are_differences),
)
