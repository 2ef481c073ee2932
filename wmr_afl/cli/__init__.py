"""The command line `wmr-afl`: one module for each group of verbs."""

# In the order of the verbs in --help.
from wmr_afl.cli import models, runs, reproduction, campaigns, exports, excitation, recording, identification  # noqa: F401, I001
from wmr_afl.cli import validation  # noqa: F401
from wmr_afl.cli.terminal import app

__all__ = ["app"]
