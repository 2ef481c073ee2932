"""What a modification of the adaptation may do: change the direction in which the estimates move."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

from wmr_afl.numerics.arrays import Array, Arrays
from wmr_afl.numerics.parts import Part


class Modification(Part):
    """theta_hat' = Gamma modify(W^T E1): against drift, large regressors, noise. `k` holds its own numbers by name."""

    @classmethod
    def from_setting(cls, setting: Any, parameters: Sequence[str]) -> Modification:
        """The modification that an experiment's key describes; `parameters` are the names of the base parameters.

        Raises:
            WmrError: if the setting does not fit.
        """
        raise NotImplementedError

    def modify(
        self,
        direction: Array,
        regressor: Array,
        filtered_error: Array,
        theta_hat: Array,
        k: SimpleNamespace,
        arrays: Arrays,
    ) -> Array:
        """The direction that leaves, (n_theta,), for W (n-m, n_theta) and E1 (n-m,)."""
        return direction
