"""C by hand, as fast as it would go."""

from collections.abc import Callable

from benchmarks.contenders import c_library
from benchmarks.contenders.work import Numbers, Summary, Work


def one(work: Work) -> Callable[[], Numbers]:
    """The first robot, in one half of a vector of two."""
    return c_library.one(work, "vectors.h", "best.c", width=2)


def many(work: Work) -> Callable[[], Summary]:
    """Eight robots at a time."""
    return c_library.many(work, "vectors.h", "best.c", width=8)
