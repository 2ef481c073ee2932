"""Equations are solved as their unknowns appear, and what cannot be solved is told."""

from __future__ import annotations

import pytest
import sympy as sp

from derive.algebra.named_terms import Terms
from derive.mechanics.elimination import Elimination, Equation, NotSolvable
from derive.mechanics.velocities import ORIGIN, Form, Velocity, rate_of

p, q, r, v, w, a, phi = sp.symbols("p q r v w a phi", real=True)


def elimination() -> Elimination:
    """In the velocities v and w, with one coordinate phi."""
    terms = Terms()
    return Elimination(terms, frozenset({v, w}), lambda e: phi not in terms.atoms(e))


def row(origin: str, is_constraint: bool = True, **coefficients: sp.Expr) -> Equation:
    names = {"p": p, "q": q, "r": r, "v": v, "w": w}
    return Equation(Form({names[k]: sp.sympify(c) for k, c in coefficients.items()}), origin, is_constraint)


def solution(solver: Elimination, symbol: sp.Symbol) -> dict[sp.Symbol, sp.Expr]:
    return {s: sp.simplify(solver.terms.expand(c)) for s, c in solver.solution(Form({symbol: sp.S.One})).items()}


def test_equations_wait_for_unknowns_that_are_not_introduced_yet() -> None:
    """p + q = 0 says nothing of p alone."""
    solver = elimination()
    solver.add([row("both", p=1, q=2), row("one", p=1, v=-a)])
    solver.introduce([p])
    solver.reduce()
    assert (solver.unsolved, [one.origin for one in solver.waiting]) == ([], ["both"])
    assert solution(solver, p) == {v: a}
    solver.introduce([q])
    solver.reduce()
    solver.finish()
    assert solution(solver, q) == {v: -a / 2}
    assert solver.independent == ["one", "both"]
    lone = elimination()
    lone.add([row("both", p=1, q=2)])
    lone.introduce([p])
    lone.reduce()
    assert (lone.unsolved, [one.origin for one in lone.waiting]) == ([p], ["both"])


def test_pivots_that_cannot_vanish_come_first() -> None:
    """Nothing is divided by a cosine where it is not needed, and numbers come before parameters."""
    solver = elimination()
    solver.introduce([p, q])
    solver.add([row("first", p=sp.cos(phi), q=1, v=-1), row("second", p=1, w=-a)])
    solver.reduce()
    solver.finish()
    assert solver.divisors == []
    assert solution(solver, p) == {w: a}
    assert solution(solver, q) == {v: 1, w: -a * sp.cos(phi)}
    needed = elimination()
    needed.introduce([p])
    needed.add([row("only", p=sp.cos(phi), v=-1)])
    needed.reduce()
    assert needed.divisors == [sp.cos(phi)]
    assert solution(needed, p) == {v: 1 / sp.cos(phi)}


def test_blocks_are_solved_together() -> None:
    """Where no single equation has a pivot that cannot vanish; rates solved before follow."""
    solver = elimination()
    c, s = sp.cos(phi), sp.sin(phi)
    solver.introduce([p, q])
    solver.define(r, Form({p: sp.S(2), q: a}))
    solver.add([row("x", p=c, q=-s, v=-1), row("y", p=s, q=c, w=-1)])
    solver.reduce()
    solver.finish()
    assert solution(solver, p) == {v: c, w: s}
    assert solution(solver, q) == {v: -s, w: c}
    assert sp.simplify(solution(solver, r)[v] - 2 * c + a * s) == 0
    assert solver.divisors == []  # the determinant is one


def test_constraints_that_follow_from_others_are_told_and_contradictions_are_refused() -> None:
    """A row twice is dependent; a pseudo-velocity that vanishes is none."""
    solver = elimination()
    solver.introduce([p])
    solver.add([row("first", p=1), row("again", p=a), row("rate", is_constraint=False, p=1, v=-1)])
    with pytest.raises(NotSolvable, match="rate"):
        solver.reduce()
    solver = elimination()
    solver.introduce([p, q])
    solver.add([row("first", p=1, q=1), row("again", p=a, q=a), row("v", is_constraint=False, q=1, v=-1)])
    solver.reduce()
    solver.finish()
    assert (solver.independent, solver.dependent) == (["first"], ["again"])


def test_coefficients_that_are_final_and_depend_on_the_configuration_get_names() -> None:
    """Constants keep their look, and what is not solved yet has no name at all."""
    solver = elimination()
    solver.introduce([p])
    curved, constant = sp.cos(phi) * sp.exp(phi) + a, a**2 + 1
    assert solver.named("speed", Form({v: curved, w: constant})) == {v: sp.Symbol("speed_v", real=True), w: constant}
    assert solver.named("other", Form({w: curved + 1})) == {w: sp.Symbol("other_w", real=True)}
    assert list(solver.terms.definitions.values()) == [curved, curved + 1]
    for form in (Form({p: curved - 1, v: a, w: curved - 2}), Form({p: curved - 3})):
        assert solver.named("open", form) == form
    assert len(solver.terms.definitions) == 2


def test_what_is_left_is_told() -> None:
    """An equation, or an unknown without any."""
    solver = elimination()
    solver.introduce([p])
    solver.reduce()
    with pytest.raises(NotSolvable, match="too few equations") as caught:
        solver.finish()
    assert caught.value.equation is None
    solver.add([row("left", p=1, q=1)])
    with pytest.raises(NotSolvable, match="left"):
        solver.finish()


def test_forms_are_added_and_substituted() -> None:
    """Coefficients that cancel are left out; what is solved takes its place, times its coefficient."""
    one, other = Form({p: sp.S(2), q: a}), Form({q: a, r: sp.S.One})
    assert one + other == {p: 2, q: 2 * a, r: 1}
    assert one - other == {p: 2, r: -1}
    assert 3 * one == {p: 6, q: 3 * a}
    assert sp.S.Zero * one == {}
    solved = {p: Form({v: a, w: sp.S(1)})}
    assert one.substitute(solved) == {v: 2 * a, w: 2, q: a}
    assert one.row([q, v, p]) == sp.Matrix([[a, 0, 2]])
    rates = {p: Form({v: sp.S(2)}), q: Form({v: sp.S(1), w: sp.S(1)})}
    assert rate_of(p * q + a, rates) == {v: 2 * q + p, w: p}


def test_a_velocity_is_stated_at_any_point_of_its_frame() -> None:
    """Moved there and back it is the same, and its component in a direction is that of a rigid body."""
    at = Velocity(Form({p: sp.S.One}), Form({q: sp.S.One}), Form({r: sp.S.One}), ORIGIN)
    point = (a, 2 * a)
    forward, lateral = at.at(point)
    assert forward == {p: 1, r: -2 * a}
    assert lateral == {q: 1, r: a}
    assert at.moved(point).moved(ORIGIN) == at
    assert at.moved(point).at(point) == (forward, lateral)
    along = at.along(point, phi)
    assert along == {p: sp.cos(phi), q: sp.sin(phi), r: sp.expand(a * sp.sin(phi) - 2 * a * sp.cos(phi))}
    assert at.symbols() == {p, q, r}
