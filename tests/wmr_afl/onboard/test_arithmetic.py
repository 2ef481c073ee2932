"""The functions that exported C has of its own are those of the C library, to the last digits."""

import ctypes

import numpy as np
import pytest

from wmr_afl.onboard.c_source import TEMPLATES
from wmr_afl.simulation.kernels.c_compiler import compiler, library

pytestmark = pytest.mark.skipif(compiler() is None, reason="there is no C compiler")


def exponentials(values: np.ndarray, is_single: bool) -> np.ndarray:
    """exp of each value, in C."""
    real, f = ("float", "f") if is_single else ("double", "")
    arithmetic = TEMPLATES.get_template("arithmetic.c.jinja").module.arithmetic  # type: ignore[attr-defined]
    loop = f"void all({real} *x, int n) {{ for (int i = 0; i < n; i++) x[i] = exp_of(x[i]); }}"
    text = f"#include <math.h>\n#include <stdint.h>\n{arithmetic('', real, f, {'exp_of'})}\n{loop}\n"
    result = np.ascontiguousarray(values, dtype=np.float32 if is_single else float)
    library(text, is_fused=False)["all"](ctypes.c_void_p(result.ctypes.data), len(result))
    return result


@pytest.mark.parametrize("is_single", [False, True])
def test_the_exponential_is_the_librarys(is_single: bool) -> None:
    kind = np.float32 if is_single else np.float64
    x = np.concatenate([np.linspace(-80.0, 80.0, 100_001), np.linspace(-1.0, 1.0, 100_001)]).astype(kind)
    wanted = np.exp(x.astype(np.longdouble))
    ulps = np.abs(exponentials(x, is_single).astype(np.longdouble) - wanted) / np.spacing(wanted.astype(kind))
    assert ulps.max() < 1.5


@pytest.mark.parametrize("is_single", [False, True])
def test_the_exponential_knows_its_ends(is_single: bool) -> None:
    x = np.array([0.0, -0.0, -np.inf, np.inf, -1e30, 1e30, np.nan])
    np.testing.assert_array_equal(exponentials(x, is_single), [1.0, 1.0, 0.0, np.inf, 0.0, np.inf, np.nan])
