"""How many small faults in the code the tests notice: `make mutants`, or `python -m tests.mutation --help`.

It stands beside the tests because it measures them; pytest does not collect it. A seeded sample of faults, equally many
from each folder, is put into a copy of the project, one at a time: a comparison is flipped, a sign swapped, a statement
dropped. For each the nearest tests run, the quickest first, then the rest of that side's for a limited time, until one
fails. The sample depends on the seed and the code alone; `equivalent_faults.toml` lists faults that change nothing.

    python -m tests.mutation --count 40 --seed 0 --folder wmr_afl/plant --folder wmr_afl/controllers
"""

from __future__ import annotations

import argparse
import ast
import importlib
import os
import random
import re
import shutil
import signal
import sys
import tempfile
import time
import tomllib
from collections import defaultdict
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from math import inf
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SIDES = ("derive", "wmr_afl", "wmr_input")
EQUIVALENT = Path(__file__).with_name("equivalent_faults.toml")
NOT_COPIED = (".git", ".venv", "results", ".*_cache", ".hypothesis", "__pycache__")
PATIENCE = 5.0  # times as long as they usually take may tests take before a fault counts as a hang
STARTS = re.compile(r"\b(subprocess|distributed|test_cli)\b")  # in tests that start processes
QUICK = 15.0  # [s] that a test file of the same folder may take, imports included, to run before all others
WHOLE = {"derive": "derive/codegen", "wmr_afl": "wmr_afl/experiments"}  # whose tests use a side as a whole
PACKAGES = "casadi jinja2 matplotlib.animation numpy pydantic rich.progress sympy typer"  # imported once
MARGIN = 20.0  # [s] more, for a machine that does other things, too

COMPARISONS = {
    ast.Lt: ("<", ("<=", ">")), ast.LtE: ("<=", ("<", ">=")), ast.Gt: (">", (">=", "<")), ast.GtE: (">=", (">", "<=")),
    ast.Eq: ("==", ("!=",)), ast.NotEq: ("!=", ("==",)), ast.In: ("in", ("not in",)), ast.NotIn: ("not in", ("in",)),
    ast.Is: ("is", ("is not",)), ast.IsNot: ("is not", ("is",)),
}  # fmt: skip
OPERATORS = {
    ast.Add: ("+", "-"), ast.Sub: ("-", "+"), ast.Mult: ("*", "/"), ast.Div: ("/", "*"), ast.Pow: ("**", "*"),
    ast.FloorDiv: ("//", "/"), ast.Mod: ("%", "+"), ast.BitAnd: ("&", "|"), ast.BitOr: ("|", "&"),
}  # fmt: skip
OTHERS = {"min": "max", "any": "all", "sin": "cos", "minimum": "maximum", "argmin": "argmax", "floor": "ceil",
          "lower": "upper", "fmin": "fmax", "first": "last", "cumsum": "cumprod"}  # fmt: skip
OTHERS |= {other: one for one, other in OTHERS.items()}
IN_ANY_ORDER = {"isinstance", "max", "min", "has", "atoms", "gcd", "lcm"}  # functions of which no argument is the first
WITHOUT_MEANING = {"maxsize", "stacklevel", "strict"}  # keywords whose values no law can speak of
DRAWINGS = {
    "plots.py",
    "animation.py",
    "campaign_plots.py",
    "figures.py",
    "beyond_figures.py",
}  # whose numbers are looks


@dataclass(frozen=True)
class Fault:
    """One change of the source of one file, which stays a program."""

    file: str  # from the project's root
    line: int
    start: int  # [bytes] from the beginning of the file
    end: int
    text: str  # that takes the place of what stands there
    source: bytes = field(repr=False)  # of the whole file

    @property
    def folder(self) -> str:
        """The folder that it counts for, at most two levels deep."""
        return "/".join(Path(self.file).parent.parts[:2])

    def applied(self) -> bytes:
        return self.source[: self.start] + self.text.encode() + self.source[self.end :]

    def lines(self) -> tuple[str, str]:
        """What stands there, and what the fault makes of it, in one line each."""
        first, last = self.source.rfind(b"\n", 0, self.start) + 1, self.source.find(b"\n", self.end)
        after = self.applied()
        old, new = self.source[first:last], after[first : last + len(after) - len(self.source)]
        return " ".join(old.decode().split()), " ".join(new.decode().split())


class _Finder(ast.NodeVisitor):
    """Collects the faults of one file: for each place all that can be done to it."""

    def __init__(self, file: str, source: bytes) -> None:
        self.file, self.source, self.found = file, source, list[Fault]()
        self.starts = [0]
        for line in source.splitlines(keepends=True):
            self.starts.append(self.starts[-1] + len(line))
        self.is_drawing = Path(file).name in DRAWINGS

    def at(self, line: int, column: int) -> int:
        return self.starts[line - 1] + column

    def text(self, node: ast.expr | ast.stmt) -> str:
        return self.source[self.span(node)[0] : self.span(node)[1]].decode()

    def span(self, node: ast.expr | ast.stmt) -> tuple[int, int]:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        return self.at(node.lineno, node.col_offset), self.at(node.end_lineno, node.end_col_offset)

    def replaced(self, node: ast.expr | ast.stmt, text: str) -> None:
        start, end = self.span(node)
        self.change(node.lineno, start, end, text)

    def change(self, line: int, start: int, end: int, text: str) -> None:
        self.found.append(Fault(self.file, line, start, end, text, self.source))

    def between(self, left: ast.expr, right: ast.expr, old: str, new: str) -> None:
        """Replace an operator, which stands between its operands with brackets around it at most."""
        start, end = self.span(left)[1], self.span(right)[0]
        place = self.source[start:end].decode().find(old)
        if place >= 0:
            begin = start + len(self.source[start:end].decode()[:place].encode())
            self.change(left.end_lineno or left.lineno, begin, begin + len(old), new)

    # What is no behaviour: annotations, decorators, imports, texts.
    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def visit_arg(self, node: ast.arg) -> None:
        pass

    def visit_Import(self, node: ast.Import) -> None:
        pass

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        pass

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        pass

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        for default in (*node.args.defaults, *node.args.kw_defaults):
            if default is not None:
                self.visit(default)
        for statement in node.body:
            self.visit(statement)

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        for statement in node.body:
            self.visit(statement)

    def visit_Module(self, node: ast.Module) -> None:
        for statement in node.body:
            is_alias = isinstance(statement, ast.Assign) and isinstance(statement.value, ast.BinOp | ast.Subscript)
            if not is_alias:
                self.visit(statement)

    def visit_Compare(self, node: ast.Compare) -> None:
        self.generic_visit(node)
        for left, operator, right in zip([node.left, *node.comparators], node.ops, node.comparators, strict=False):
            old, others = COMPARISONS[type(operator)]
            for new in others:
                self.between(left, right, old, new)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        self.generic_visit(node)
        is_text = isinstance(node.left, ast.Constant | ast.JoinedStr) and not self.is_number(node.left)
        if type(node.op) in OPERATORS and not is_text:
            self.between(node.left, node.right, *OPERATORS[type(node.op)])

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        self.visit(node.value)
        self.replaced(node, "pass")
        if type(node.op) in OPERATORS:
            old, new = OPERATORS[type(node.op)]
            self.between(node.target, node.value, old + "=", new + "=")

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        self.generic_visit(node)
        if isinstance(node.op, ast.Not | ast.USub):
            self.replaced(node, f"({self.text(node.operand)})")

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        self.generic_visit(node)
        old, new = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
        for left, right in zip(node.values, node.values[1:], strict=False):
            self.between(left, right, old, new)

    def visit_Constant(self, node: ast.Constant) -> None:
        value = node.value
        if isinstance(value, bool):
            self.replaced(node, str(not value))
        elif self.is_number(node) and not self.is_drawing and isinstance(value, int | float):
            if isinstance(value, int):
                self.replaced(node, repr(value + 1 if value <= 10 else 2 * value))
            else:
                self.replaced(node, repr(1.0 if value == 0.0 else 1e4 * value if value < 1e-5 else 2.0 * value))

    @staticmethod
    def is_number(node: ast.expr) -> bool:
        return isinstance(node, ast.Constant) and isinstance(node.value, int | float)

    def visit_keyword(self, node: ast.keyword) -> None:
        if node.arg not in WITHOUT_MEANING:
            self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        self.generic_visit(node)
        name = node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")
        if name in OTHERS:
            self.replaced(node.func, self.text(node.func)[: -len(name)] + OTHERS[name])
        simple = [argument for argument in node.args if isinstance(argument, ast.Name | ast.Attribute)]
        if len(simple) >= 2 and len(node.args) == len(simple) and name not in IN_ANY_ORDER:
            first, second = simple[:2]
            if self.text(first) != self.text(second):
                start, end = self.span(first)[0], self.span(second)[1]
                swapped = self.text(second) + self.source[self.span(first)[1] : self.span(second)[0]].decode()
                self.change(first.lineno, start, end, swapped + self.text(first))

    def visit_Expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):
            self.generic_visit(node)
            if isinstance(node.value, ast.Call):
                self.replaced(node, "pass")

    def visit_Raise(self, node: ast.Raise) -> None:
        self.replaced(node, "pass")

    def visit_Continue(self, node: ast.Continue) -> None:
        self.replaced(node, "pass")

    def visit_Break(self, node: ast.Break) -> None:
        self.replaced(node, "pass")

    def negated(self, condition: ast.expr) -> None:
        if not isinstance(condition, ast.Compare) or len(condition.ops) > 1:
            self.replaced(condition, f"(not ({self.text(condition)}))")

    def visit_If(self, node: ast.If) -> None:
        self.generic_visit(node)
        self.negated(node.test)

    def visit_IfExp(self, node: ast.IfExp) -> None:
        self.generic_visit(node)
        self.negated(node.test)

    def visit_comprehension(self, node: ast.comprehension) -> None:
        self.generic_visit(node)
        for condition in node.ifs:
            self.replaced(condition, "True")


def faults_of(file: str) -> list[Fault]:
    """Every fault that can be put into a file, each of them once."""
    source = (ROOT / file).read_bytes()
    finder = _Finder(file, source)
    finder.visit(ast.parse(source))
    return [fault for fault in dict.fromkeys(finder.found) if _is_program(fault.applied())]


def _is_program(source: bytes) -> bool:
    try:
        ast.parse(source)
    except SyntaxError:
        return False
    return True


def sample(count: int, seed: int, folders: list[str]) -> list[Fault]:
    """So many faults, in turn from each folder; within a folder every place is as likely as any other."""
    chosen = random.Random(seed)  # noqa: S311, no secret
    by_folder: dict[str, list[Fault]] = defaultdict(list)
    for side in SIDES:
        for path in sorted((ROOT / side).rglob("*.py")):
            file = path.relative_to(ROOT).as_posix()
            if not folders or any(f"{file}/".startswith(f"{folder.rstrip('/')}/") for folder in folders):
                for fault in faults_of(file):
                    by_folder[fault.folder].append(fault)
    drawn = []
    for name in sorted(by_folder):
        places: dict[tuple[str, int], list[Fault]] = defaultdict(list)
        for fault in by_folder[name]:
            places[fault.file, fault.start].append(fault)
        order = list(places.values())
        chosen.shuffle(order)
        drawn.append([chosen.choice(one) for one in order])
    rounds = [one[i] for i in range(max(map(len, drawn), default=0)) for one in drawn if i < len(one)]
    return rounds[:count]


class Copy:
    """A copy of the project in which faults are put one at a time."""

    def __init__(self, place: Path) -> None:
        self.root, self.cache = place / "project", place / "cache"
        shutil.copytree(ROOT, self.root, ignore=shutil.ignore_patterns(*NOT_COPIED), symlinks=True)

    def pytest(self, files: list[str], limit: float, *options: str) -> int | None:
        """The exit status of these test files, 0 if all pass; None if they take longer than `limit` [s].

        They run in a fork of this process, which has imported all packages but the project's.
        """
        process = os.fork()
        if process == 0:
            self._become_pytest(["-x", "-q", "-p", "no:cacheprovider", *options, *files])
        end = time.monotonic() + limit
        while time.monotonic() < end:
            done, status = os.waitpid(process, os.WNOHANG)
            if done:
                return os.waitstatus_to_exitcode(status)
            time.sleep(0.02)
        with suppress(ProcessLookupError):
            os.killpg(process, signal.SIGKILL)  # the group of the fork
        os.waitpid(process, 0)
        return None

    def _become_pytest(self, arguments: list[str]) -> None:
        status = 9
        try:
            os.setsid()
            nothing = os.open(os.devnull, os.O_RDWR)
            for stream in range(3):
                os.dup2(nothing, stream)
            os.chdir(self.root)
            os.environ |= {"PYTHONPATH": str(self.root), "PYTHONDONTWRITEBYTECODE": "1"}
            os.environ["WMR_AFL_CACHE"] = str(self.cache)
            sys.dont_write_bytecode = True
            sys.path[:] = [str(self.root), *(entry for entry in sys.path if Path(entry).resolve() != ROOT)]
            for name in [name for name in sys.modules if name.split(".")[0] in ("tests", "benchmarks", *SIDES)]:
                del sys.modules[name]
            package = importlib.import_module("wmr_afl").__file__ or ""
            if Path(package).is_relative_to(self.root.resolve()):
                status = int(pytest.main(arguments))
        except BaseException:
            status = 3  # a fault that cannot be imported
        finally:
            os._exit(status)

    def durations(self, files: list[str]) -> dict[str, float]:
        """Seconds that each test file takes, infinitely many if more than `QUICK`; those that end must pass."""
        seconds = {}
        for file in files:
            begin = time.monotonic()
            status = self.pytest([file], QUICK)
            if status not in (0, None):
                raise SystemExit(f"without any fault tests of {file} fail")
            seconds[file] = inf if status is None else time.monotonic() - begin
        return seconds


@cache
def test_files(folder: Path) -> dict[str, bool]:
    """Test files below a folder of tests, and whether they start processes, which takes seconds."""
    files = sorted((ROOT / folder).rglob("test_*.py"))
    return {path.relative_to(ROOT).as_posix(): bool(STARTS.search(path.read_text())) for path in files}


@cache
def near(folder: str) -> tuple[str, ...]:
    """The quick test files below the folder that mirrors a folder of code, or below the nearest one above it."""
    place = Path("tests", WHOLE.get(folder, folder))
    while not test_files(place):
        place = place.parent
    files = dict(test_files(place))
    if folder in WHOLE:  # and those of the side itself
        files |= {file: slow for file, slow in test_files(Path("tests", folder)).items() if file.count("/") == 2}
    quick = tuple(file for file, is_slow in files.items() if not is_slow)
    return quick or near(Path(folder).parent.as_posix())


@cache
def far(folder: str) -> tuple[str, ...]:
    """The other test files of that side: those that start processes last, and of these the nearest ones first."""
    side = folder.split("/")[0]
    files = dict(test_files(Path("tests", side)))
    if side == "wmr_input":
        files |= test_files(Path("tests", "derive", "description"))
    left = [file for file in files if file not in near(folder)]
    return tuple(sorted(left, key=lambda file: (files[file], not file.startswith(f"tests/{folder}/"), file)))


def noticed(fault: Fault, copy: Copy, usual: dict[str, float], seconds: float) -> str:
    """Which tests noticed a fault: "near", "far", "hangs", or "" if none did."""
    path, folder = copy.root / fault.file, Path(fault.file).parent.as_posix()
    path.write_bytes(fault.applied())
    try:
        files = sorted(near(folder), key=lambda file: usual[file])
        quick = [file for file in files if usual[file] <= QUICK]
        status = copy.pytest(quick, PATIENCE * sum(usual[file] for file in quick) + MARGIN) if quick else 0
        if status != 0:
            return "hangs" if status is None else "near"
        others = [file for file in files if file not in quick] + list(far(folder))
        return "far" if others and seconds > 0.0 and copy.pytest(others, seconds) not in (0, None) else ""
    finally:
        path.write_bytes(fault.source)


def equivalent() -> dict[tuple[str, str, str], str]:
    """Faults that change nothing, by file, line and changed line, and the reasons."""
    listed = tomllib.loads(EQUIVALENT.read_text())["fault"] if EQUIVALENT.exists() else []
    return {(one["file"], one["old"], one["new"]): one["reason"] for one in listed}


def examined(faults: list[Fault], seconds: float) -> Iterator[tuple[Fault, str]]:
    """Each fault with what noticed it."""
    with tempfile.TemporaryDirectory() as place:
        copy, usual = Copy(Path(place)), dict[str, float]()
        for files in dict.fromkeys(near(Path(fault.file).parent.as_posix()) for fault in faults):
            begin, unknown = time.monotonic(), [file for file in files if file not in usual]
            usual |= copy.durations(unknown) if unknown else {}
            print(f"{len(unknown)} test files tried in {time.monotonic() - begin:.0f} s: {files[0]} ...", flush=True)
        others = sorted({file for fault in faults for file in far(Path(fault.file).parent.as_posix())})
        if others and seconds > 0.0 and copy.pytest(others, inf, "--collect-only") != 0:
            raise SystemExit("without any fault tests of other folders cannot be collected")  # every one would count
        for fault in faults:
            yield fault, noticed(fault, copy, usual, seconds)


def main() -> None:
    """Print each fault that is examined, and the score of each folder."""
    parser = argparse.ArgumentParser(description="Put small faults into the code and count those that tests notice.")
    parser.add_argument("--count", type=int, default=40, help="how many faults, in turn from each folder")
    parser.add_argument("--seed", type=int, default=0, help="which of them")
    parser.add_argument("--folder", action="append", default=[], help="such as wmr_afl/plant; may be repeated")
    parser.add_argument("--seconds", type=float, default=120.0, help="for tests of other folders, of each fault")
    options = parser.parse_args()
    faults, reasons = sample(options.count, options.seed, options.folder), equivalent()
    for package in PACKAGES.split():
        importlib.import_module(package)
    counts: dict[str, list[int]] = defaultdict(lambda: [0, 0, 0])
    for number, (fault, by) in enumerate(examined(faults, options.seconds), 1):
        old, new = fault.lines()
        reason = reasons.get((fault.file, old, new), "")
        verdict = by or ("equivalent" if reason else "NOT NOTICED")
        print(f"{number}/{len(faults)} {verdict}: {fault.file}:{fault.line}\n    - {old}\n    + {new}", flush=True)
        if verdict == "equivalent":
            print(f"      {reason}")
            counts[fault.folder][2] += 1
        else:
            counts[fault.folder][0 if by else 1] += 1
    total = [sum(column) for column in zip(*counts.values(), strict=True)] if counts else [0, 0, 0]
    for folder, (seen, missed, same) in [*sorted(counts.items()), ("all", total)]:
        share = f"{seen / (seen + missed):4.0%}" if seen + missed else "   -"
        note = f", {same} change nothing" if same else ""
        print(f"{folder:<24} {share} noticed, {seen} of {seen + missed}{note}")


if __name__ == "__main__":
    main()
