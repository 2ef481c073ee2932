"""`python tests/fuzz.py [--times N] [--seed S] [WORD]`: the fuzz tests for longer, seed after seed, until one fails.

A fuzz test takes its seed and its budget from `tests/fuzzing.py`, which reads the environment: WMR_AFL_FUZZ_SEED, and
WMR_AFL_FUZZ, how many times as much as in the suite. To add one, let it take both from there, and add it to `TESTS`.
"""

from __future__ import annotations

import argparse
import itertools
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
TESTS = {  # kind of input -> its file, or a test in it
    "models": "tests/wmr_afl/model/test_tampered_models.py",
    "campaign folders, results": "tests/wmr_afl/experiments/campaigns/test_tampered_folders.py",
    "descriptions": "tests/derive/description/test_junk_descriptions.py",
    "experiments, campaigns": "tests/wmr_afl/experiments/test_junk_experiments.py",
    "API arguments": "tests/wmr_afl/test_junk_arguments.py",
    "interrupted writing": "tests/wmr_afl/test_interrupted_writing.py",
}


def main() -> int:
    """Run until a test fails; the seed of the failure is printed."""
    reader = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    reader.add_argument("word", nargs="?", default="", help=f"a part of one of: {'; '.join(TESTS)}")
    reader.add_argument("--seed", type=int, default=1, help="the first seed")
    reader.add_argument("--times", type=int, default=4, help="how many times the budget of the suite for each seed")
    reader.add_argument("--seeds", type=int, default=0, help="how many seeds; 0: until a test fails")
    given = reader.parse_args()
    chosen = [file for kind, file in TESTS.items() if given.word in kind]
    if not chosen:
        print(f"error: no kind of input has {given.word!r} in its name; there is {'; '.join(TESTS)}", file=sys.stderr)
        return 2
    last = given.seed + given.seeds if given.seeds else None
    for seed in itertools.takewhile(lambda one: last is None or one < last, itertools.count(given.seed)):
        print(f"seed {seed}", flush=True)
        environment = {**os.environ, "WMR_AFL_FUZZ_SEED": str(seed), "WMR_AFL_FUZZ": str(given.times)}
        status = subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-x", *chosen], cwd=ROOT, env=environment, check=False
        ).returncode
        if status:
            print(f"failed; again with: python tests/fuzz.py --seed {seed} --times {given.times} --seeds 1", flush=True)
            return status
    return 0


if __name__ == "__main__":
    sys.exit(main())
