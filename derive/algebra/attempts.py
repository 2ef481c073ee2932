"""Findings that only inform: one that fails is noted with its reason, and stops no derivation."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from wmr_input import WmrError

from .finite_field import NotRepresentable

Found = TypeVar("Found")
_LONGEST_REASON = 80  # characters


class Attempts:
    """What is tried, and in `missed` what was not found out: finding -> why."""

    def __init__(self) -> None:
        self.missed: dict[str, str] = {}

    def __call__(self, finding: str, find: Callable[[], Found], otherwise: Found) -> Found:
        """What `find` finds, or `otherwise` if it fails."""
        try:
            return find()
        except WmrError:
            raise
        except Exception as error:  # computer algebra fails in many ways, each of them with an exception of its own
            self.missed[finding] = reason(error)
            return otherwise


def reason(error: Exception) -> str:
    """Why something failed, in a few words."""
    if isinstance(error, NotRepresentable):
        return f"{shown(error.expression)} is not defined at random configurations"
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text[:_LONGEST_REASON]}" if text else type(error).__name__


def shown(expression: object) -> str:
    """An expression as text, a long one cut off."""
    text = " ".join(str(expression).split())
    return text if len(text) <= _LONGEST_REASON else f"{text[: _LONGEST_REASON - 3]}..."
