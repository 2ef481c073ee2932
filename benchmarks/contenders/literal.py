"""C by hand, straight from the paper's equations."""

from collections.abc import Callable

from benchmarks.contenders import c_library
from benchmarks.contenders.work import Numbers, Summary, Work


def one(work: Work) -> Callable[[], Numbers]:
    """The first robot."""
    return c_library.one(work, "literal.c")


def many(work: Work) -> Callable[[], Summary]:
    """Robot after robot."""
    return c_library.many(work, "literal.c")
