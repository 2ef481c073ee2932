"""A closed loop's step as one function of symbols, traced from the text that NumPy runs."""

from __future__ import annotations

import functools

import casadi as ca

from wmr_afl.closed_loop import ClosedLoop, Layout
from wmr_afl.language import Language


@functools.lru_cache(maxsize=32)
def trace(loop: ClosedLoop) -> ca.Function:
    """The loop's step as one function of flat columns: (state, t, noise sample, values) -> (next state, signals)."""
    language = Language.of(loop.model, "casadi")
    states, values = Layout(loop.states), Layout(loop.values)
    z, k = ca.SX.sym("state", states.size), ca.SX.sym("values", values.size)
    t, sample = ca.SX.sym("t"), ca.SX.sym("sample", loop.signals["x"])
    following, now = loop.step(t, states.unpack_symbols(z), values.unpack_symbols(k), sample, language)
    outputs = [ca.densify(states.pack_symbols(following)), ca.densify(loop.signal_layout.pack_symbols(now))]
    return ca.Function(
        "step", [z, t, sample, k], ca.cse(outputs), ["state", "t", "sample", "values"], ["next", "signals"]
    )
