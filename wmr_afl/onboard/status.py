"""What a sample comes to: the same numbers in Python and in C."""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    """OK, or why there are no voltages."""

    def __new__(cls, number: int, meaning: str) -> Status:
        one = int.__new__(cls, number)
        one._value_, one.meaning = number, meaning
        return one

    meaning: str

    OK = 0, "voltages were computed, and the state has moved on"
    BAD_MEASUREMENT = 1, "x holds what is not finite"
    BAD_REFERENCE = 2, "the setpoint holds what is not finite"
    BAD_TIME_STEP = 3, "dt is not above zero, or not finite"
    BAD_STATE = 4, "the state is not finite, or beyond its bounds: begin again"
    SINGULAR = 5, "what is inverted is singular"
    LOST = 6, "what is measured is too far from what an observer expected"
    NOT_FINITE = 7, "what came out is not finite"
    OTHER_LAYOUT = 8, "a saved state of another controller, or of another precision"
    DAMAGED = 9, "a saved state whose check sum does not fit"
