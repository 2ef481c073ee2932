"""`derivation.md`: the derivation in equations, as a person would want to read it."""

from __future__ import annotations

from collections.abc import Iterable

import sympy as sp
from sympy import Expr, Matrix, Symbol

from ..algebra.formula_text import with_decimals
from ..derivation import Derivation
from .metadata import Metadata
from .program import Program
from .rendering import render

_READABLE = 60  # operations; longer expressions are shown in named terms


_GREEK = ("alpha", "beta", "gamma", "delta", "theta", "phi", "psi", "omega", "pi")


def print_report(derivation: Derivation, metadata: Metadata, programs: list[Program]) -> str:
    """The text of `derivation.md`."""
    tex = _Tex(derivation)
    operations = [(one.quantity.name, one.quantity.equation, one.steps.operations) for one in programs]
    return render(
        "derivation.md.jinja",
        metadata=metadata,
        findings=metadata.findings,
        d=derivation,
        tex=tex,
        operations=operations,
        zip=zip,
        column=lambda entries: Matrix(list(entries)),
    )


class _Tex:
    """Formulas in LaTeX; collects the named terms that they leave unexpanded."""

    def __init__(self, derivation: Derivation) -> None:
        self.derivation = derivation
        self._open: list[Expr] = []

    def __call__(self, expression: Expr | Matrix) -> str:
        """`expression` in the user's symbols if that is short, else in named terms."""
        terms = self.derivation.terms
        expand = terms.expand if isinstance(expression, sp.Expr) else lambda m: m.applyfunc(terms.expand)
        expanded = expand(expression)
        if sp.count_ops(expanded) > _READABLE:
            expanded = expression
            self._open.extend([expression] if isinstance(expression, sp.Expr) else list(expression))
        return self.plain(expanded)

    def denominator(self, expression: Expr) -> str:
        """The denominator of `expression`."""
        return self(sp.fraction(expression)[1])

    def expanded(self, expression: Expr) -> str:
        """`expression` in the user's symbols, however long."""
        return self.plain(sp.factor_terms(self.derivation.terms.expand(expression)))

    def plain(self, expression: Expr | Matrix) -> str:
        """`expression` as it stands."""
        short = with_decimals(expression) if isinstance(expression, sp.Expr) else expression.applyfunc(with_decimals)
        return str(sp.latex(short, symbol_names={s: _name(s.name) for s in short.free_symbols}))

    def column(self, symbols: Iterable[Symbol | str]) -> str:
        names = [_name(s if isinstance(s, str) else s.name) for s in symbols]
        return r"\begin{bmatrix}" + r" & ".join(names) + r"\end{bmatrix}^T"

    def name(self, symbol: Symbol | str) -> str:
        return _name(symbol if isinstance(symbol, str) else symbol.name)

    def named_terms(self) -> list[tuple[str, str]]:
        """The named terms that formulas printed so far rest on."""
        needed = self.derivation.terms.needed(self._open)
        return [(_name(symbol.name), self.plain(definition)) for symbol, definition in needed.items()]


def _name(name: str) -> str:
    """m_C -> m_{C}, beta1_dot -> \\dot{\\beta_{1}}, trailer_1_turning_v -> upright words."""
    if name[:1].isdigit():
        return name.replace("*pi", r" \pi")
    if name.endswith("_dot"):
        return rf"\dot{{{_name(name[:-4])}}}"
    head, _, rest = name.partition("_")
    letters = head.rstrip("0123456789")
    index = ",".join(part for part in (head[len(letters) :], rest) if part)
    if "_" in rest or (len(letters) > 1 and letters.lower() not in _GREEK):
        return r"\mathrm{" + name.replace("_", r"\_") + "}"
    symbol = rf"\{letters}" if letters.lower() in _GREEK else letters
    return f"{symbol}_{{{index}}}" if index else symbol
