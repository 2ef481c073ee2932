"""The engine is imported as the product imports it, which decides how it draws, before any test module does."""

from contextlib import suppress

from wmr_afl.errors import WmrError
from wmr_afl.validation.engine import mujoco

with suppress(WmrError):  # not installed: the tests say so
    mujoco()
