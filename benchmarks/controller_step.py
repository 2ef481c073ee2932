"""One step of study 1's controller, and of its whole closed loop."""

from __future__ import annotations

import numpy as np
from rich.table import Table

from benchmarks.timing import best_times
from wmr_afl.experiments.assembly import assemble
from wmr_afl.experiments.experiment import read_experiment
from wmr_afl.numerics.parts import by_part
from wmr_afl.simulation.simulate import simulate


def measure() -> Table:
    """Time of one step [us] in each library."""
    loop = assemble(*read_experiment("study_1"))["AFL"]
    model = loop.model.in_library("numpy")
    z, k, x = by_part(loop.states), by_part(loop.values), loop.plant.start
    reference = loop.reference.at(0.0)

    def controller() -> object:
        action = loop.law.act(x, reference, z, k, model)
        return loop.law.update(x, action, action.input, z, k, model, loop.sample_time)

    runs = {backend: (lambda b=backend: simulate(loop, 20.0, backend=b)) for backend in ("numpy", "casadi")}
    stepwise, traced = runs["numpy"](), runs["casadi"]()
    np.testing.assert_allclose(traced.state, stepwise.state, rtol=1e-9, atol=1e-9)
    times = best_times({"controller": controller, **runs}, seconds=4.0, turns=8)
    table = Table("work", "time [us]", title="Study 1, one step of 7000", title_justify="left")
    table.add_row("controller: command and update, NumPy", f"{1e6 * times['controller']:.1f}")
    for backend in runs:
        table.add_row(f"closed loop, backend {backend}", f"{1e6 * times[backend] / len(stepwise.time):.2f}")
    table.add_row("ratio of the two", f"{times['numpy'] / times['casadi']:.1f}")
    return table
