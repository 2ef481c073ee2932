"""One step of study 1's controller, and of its whole closed loop."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from rich.table import Table

from benchmarks.timing import best_times
from wmr_afl.experiments.assembly import assemble
from wmr_afl.experiments.experiment import read_experiment
from wmr_afl.model.model import Language
from wmr_afl.simulation.simulate import simulate


def measure() -> Table:
    """Time of one step [us] in each language."""
    loop = assemble(*read_experiment("study_1"))["AFL"]
    language = Language.of(loop.model, "numpy")
    z, k, x = SimpleNamespace(**loop.states), SimpleNamespace(**loop.values), loop.plant.start
    reference = loop.reference.at(0.0)

    def controller() -> object:
        action = loop.controller.act(x, reference, z, k, language)
        return loop.controller.update(x, action, action.input, z, k, loop.sample_time, language)

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
