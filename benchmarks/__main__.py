"""`python -m benchmarks [NAME ...]`: measure and print."""

import sys

from rich.console import Console

from benchmarks import closed_loops, controller_step, growth, scaling, terms

BENCHMARKS = {
    "terms": terms.measure,
    "controller_step": controller_step.measure,
    "closed_loops": closed_loops.measure,
    "scaling": scaling.measure,
    "growth": growth.measure,
}


def main() -> int:
    wanted = sys.argv[1:] or list(BENCHMARKS)
    for name in wanted:
        if name not in BENCHMARKS:
            print(f"error: unknown benchmark {name!r}; there is {', '.join(BENCHMARKS)}", file=sys.stderr)
            return 2
    for name in wanted:
        Console(width=150, markup=False).print(BENCHMARKS[name]())
    return 0


if __name__ == "__main__":
    sys.exit(main())
