"""`python -m wmr_afl` is `wmr-afl`."""

from wmr_afl.cli import app

app(prog_name="wmr-afl")
