"""What a sample comes to: the same numbers in Python and in C."""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    """OK, or why there are no voltages."""

    OK = 0
    BAD_MEASUREMENT = 1
    BAD_REFERENCE = 2
    BAD_TIME_STEP = 3
    BAD_STATE = 4
    SINGULAR = 5
    LOST = 6
    NOT_FINITE = 7
    OTHER_LAYOUT = 8
    DAMAGED = 9

    @property
    def meaning(self) -> str:
        """In words."""
        return _MEANINGS[self]


_MEANINGS = {
    Status.OK: "voltages were computed, and the state has moved on",
    Status.BAD_MEASUREMENT: "x holds what is not finite",
    Status.BAD_REFERENCE: "the setpoint holds what is not finite",
    Status.BAD_TIME_STEP: "dt is not above zero, or not finite",
    Status.BAD_STATE: "the state is not finite, or beyond its bounds: begin again",
    Status.SINGULAR: "what is inverted is singular",
    Status.LOST: "what is measured is too far from what an observer expected",
    Status.NOT_FINITE: "what came out is not finite",
    Status.OTHER_LAYOUT: "a saved state of another controller, or of another precision",
    Status.DAMAGED: "a saved state whose check sum does not fit",
}
