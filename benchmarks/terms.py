"""Generated NumPy terms against `sympy.lambdify(cse=True)` and against hand-written NumPy, per state."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import sympy as sp
from rich.table import Table

from benchmarks import handwritten
from benchmarks.timing import best_times
from derive.codegen.quantities import quantities
from derive.derivation import derive_robot
from wmr_afl import load_model

TERMS = ("state_derivative", "lie_f2_h", "lie_q_lie_f_h", "decoupling_matrix", "regressor")
BATCHES = (1, 1000, 100000)
ROBOT = Path(__file__).parents[1] / "derive" / "robots" / "type_2_0.toml"


def measure() -> Table:
    """Time per state [ns] and ratios to the generated code."""
    table = Table(
        "term", "batch", "generated [ns]", "hand-written", "lambdify", "hand-written / gen.", "lambdify / gen.",
        title="NumPy terms, time per state", title_justify="left",
    )  # fmt: skip
    model, random = load_model("type_2_0"), np.random.default_rng(0)
    derivation = derive_robot(ROBOT)
    derived = {quantity.name: quantity for quantity in quantities(derivation)}
    for term in TERMS:
        quantity = derived[term]
        expanded = quantity.expression.applyfunc(derivation.terms.expand)
        lambdified = _lambdified([argument.entries for argument in quantity.arguments], expanded)
        for batch in BATCHES:
            arrays = [random.uniform(0.5, 1.5, (batch, len(argument.entries))) for argument in quantity.arguments]
            contenders: dict[str, Callable] = {
                "generated": model.functions()[term],
                "hand-written": getattr(handwritten, term),
                "lambdify": lambdified,
            }
            results = {name: call(*arrays) for name, call in contenders.items()}
            for name, result in results.items():
                shaped = np.reshape(result, results["generated"].shape)
                np.testing.assert_allclose(
                    shaped, results["generated"], rtol=1e-12, atol=1e-12, err_msg=f"{term} {name}"
                )
            times = best_times({name: (lambda f=call, a=arrays: f(*a)) for name, call in contenders.items()})
            each = {name: 1e9 * seconds / batch for name, seconds in times.items()}
            table.add_row(
                term, f"{batch:g}", *(f"{each[name]:.3g}" for name in contenders),
                f"{times['hand-written'] / times['generated']:.2f}", f"{times['lambdify'] / times['generated']:.2f}",
            )  # fmt: skip
    return table


def _lambdified(arguments: list[tuple[sp.Symbol, ...]], matrix: sp.Matrix) -> Callable:
    """SymPy's own code; its entries are stacked, because it cannot broadcast a matrix with constant entries."""
    function = sp.lambdify(arguments, list(matrix), "numpy", cse=True)

    def call(*arrays: np.ndarray) -> np.ndarray:
        entries = function(*(np.moveaxis(array, -1, 0) for array in arrays))
        return np.stack(np.broadcast_arrays(*entries), axis=-1)

    return call
