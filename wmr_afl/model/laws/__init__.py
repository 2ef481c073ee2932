"""The laws that every generated model obeys, whatever the robot: what the tests run, and `wmr-afl check`."""

from wmr_afl.model.laws import code, effort, forces, linearization, mechanics, parametrization, passivity
from wmr_afl.model.laws.law import Law, Situation

LAWS: tuple[Law, ...] = (
    *mechanics.LAWS,
    *forces.LAWS,
    *linearization.LAWS,
    *parametrization.LAWS,
    *passivity.LAWS,
    *effort.LAWS,
    *code.LAWS,
)

__all__ = ["LAWS", "Law", "Situation"]
