"""Numbers that follow from other numbers: a gain relative to the first estimate, an estimate that follows from p.

The same rules serve one robot, when an experiment is assembled, and N robots, when a batch makes them differ: one is a
batch of one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from wmr_afl.numerics.arrays import Floats

Rule = Callable[["Numbers"], Floats]  # one number from the others
Rules = Mapping[str, Rule]  # by the name of the number that follows


class Numbers:
    """Numbers of a closed loop by name, (...) or with robots in front, (N, ...).

    A number is what is `given`, else what its rule makes of others, else what stands in `otherwise`; times its `scale`
    (N,), or (N, ...) entry by entry. It may overflow: whoever uses it looks whether it is finite, and says it in words.
    """

    def __init__(
        self,
        rules: Rules,
        given: Mapping[str, Floats],
        otherwise: Mapping[str, Floats] | None = None,
        scale: Mapping[str, Floats] | None = None,
    ) -> None:
        self._rules, self._given, self._otherwise, self._scale = rules, given, otherwise or {}, scale or {}
        self._found: dict[str, Floats] = {}

    def __getitem__(self, name: str) -> Floats:
        if name not in self._found:
            with np.errstate(all="ignore"):
                value = self._unscaled(name)
                if name in self._scale:
                    factors = self._scale[name]
                    if factors.ndim == 1:  # one for each robot, else one for each of its entries
                        factors = factors.reshape(len(factors), *(1 for _ in np.shape(self._otherwise[name])))
                    value = value * factors
            self._found[name] = value
        return self._found[name]

    def _unscaled(self, name: str) -> Floats:
        if name in self._given:
            return self._given[name]
        return self._rules[name](self) if name in self._rules else self._otherwise[name]
