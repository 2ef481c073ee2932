"""Experiment tables -> the objects of a closed loop, with every mistake reported where it stands in the file."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wmr_afl.controllers import (
    GradientAdaptation,
    Leakage,
    LinearizingLaw,
    Normalization,
    OuterLoop,
    Projection,
    RobustTerm,
    TrackingController,
)
from wmr_afl.controllers import reference as references
from wmr_afl.controllers.adaptation import AdaptationTable
from wmr_afl.controllers.reference import Reference, ReferenceTable
from wmr_afl.controllers.tracking_law import ControllerTable
from wmr_afl.errors import UnknownNameError, WmrError
from wmr_afl.experiments.experiment import Experiment
from wmr_afl.experiments.initial_estimates import adaptation_gain, first_estimate, relative_bounds
from wmr_afl.model.files import model_folder
from wmr_afl.model.model import load_model
from wmr_afl.model.plausibility import check_robots
from wmr_afl.numerics.arrays import Vector
from wmr_afl.numerics.vectors import by_name
from wmr_afl.plant import Plant
from wmr_afl.plant.uncertainties import build_effects
from wmr_afl.simulation.closed_loop import ClosedLoop
from wmr_input.errors import mistakes_at


def assemble(experiment: Experiment, file: Path) -> dict[str, ClosedLoop]:
    """The closed loop of every controller of an experiment that stands in `file`.

    Raises: InputError, naming file, table and remedy.
    """
    assembly = _Assembly(experiment, file)
    return {name: assembly.loop(name) for name in experiment.controllers}


def model_of(experiment: Experiment, file: Path) -> Path:
    """The folder of an experiment's model: one beside its file, one by its path, or a shipped one by its name.

    Raises: InputError, where there is none.
    """
    beside = file.parent / experiment.robot
    with mistakes_at(file, "robot"):
        return beside if (beside / "model.json").is_file() else model_folder(experiment.robot)


@dataclass
class _Assembly:
    experiment: Experiment
    file: Path

    def __post_init__(self) -> None:
        with self.at("robot"):
            self.model = load_model(model_of(self.experiment, self.file))
            if not self.model.output_units:
                raise WmrError(f"model {self.model.name} has no outputs to track", "derive it with [outputs]")
        with self.at("[parameters]"):
            self.parameters = self.model.parameters(**self.experiment.parameters)
            check_robots(self.model, self.experiment.start, self.parameters)
        self.reference = self._reference(self.experiment.reference)

    def at(self, place: str) -> AbstractContextManager[None]:
        """Errors inside are mistakes at `place` of the file."""
        return mistakes_at(self.file, place)

    def loop(self, name: str) -> ClosedLoop:
        return ClosedLoop(
            self.model,
            self._plant(),
            self._controller(name, self.experiment.controller(name)),
            self.reference,
            self.experiment.simulation.sample_time,
        )

    def _plant(self) -> Plant:
        effects = build_effects(self.experiment, self.model, self.at)
        with self.at("[start]"):
            start = by_name("state", self.experiment.start, list(self.model.state_units), missing=0.0)
            return Plant(self.model, self.parameters, start, self.experiment.simulation.integrator, **effects)

    def _reference(self, table: ReferenceTable) -> Reference:
        outputs = list(self.model.output_units)
        if table.expressions is not None:
            with self.at("[reference.expressions]"):
                unknown = [name for name in table.expressions if name not in outputs]
                if unknown:
                    raise UnknownNameError("output", unknown[0], outputs)
                missing = [name for name in outputs if name not in table.expressions]
                if missing:
                    raise WmrError(f"output {missing[0]!r} has no reference", f'add {missing[0]} = "..."')
                return Reference({name: table.expressions[name] for name in outputs})
        kind, given = next((kind, value) for kind, value in vars(table).items() if value is not None)
        expressions: list[str] = getattr(references, kind)(**given.model_dump())
        with self.at(f"[reference.{kind}]"):
            if len(expressions) != len(outputs):
                raise WmrError(
                    f"gives {len(expressions)} coordinates for {len(outputs)} outputs ({', '.join(outputs)})",
                    "write [reference.expressions]",
                )
            return Reference(dict(zip(outputs, expressions, strict=True)))

    def _controller(self, name: str, table: ControllerTable) -> TrackingController:
        model = self.model

        def place(key: str) -> str:
            return self.experiment.place(name, key)

        outputs, thetas = len(model.output_units), list(model.base_parameter_units)
        with self.at(place("outer_loop")):
            if table.outer_loop is None:
                raise WmrError("is missing", "add outer_loop = { b1 = ..., b2 = ... } here or under [shared]")
            outer_loop = OuterLoop(outputs, **table.outer_loop.model_dump())
        with self.at(place("guess")):
            if table.guess and table.estimate != "exact":
                raise WmrError("stands beside an estimate", "give one of them")
            for parameter in table.guess:
                if parameter in model.known_units:
                    raise WmrError(f"the controller knows {parameter}", "guess uncertain parameters")
        with self.at(place("guess" if table.guess else "estimate")):
            estimate = first_estimate(model, self.experiment.parameters, table)
            if not np.all(np.isfinite(estimate)):
                raise WmrError("gives base parameters that are not finite", "guess values that a robot can have")
        adaptation = None
        if table.adaptation is not None:
            with self.at(place("adaptation")):
                adaptation = _adaptation(table.adaptation, estimate, thetas)
        with self.at(place("projection")):
            if adaptation is None and "projection" in self.experiment.controllers[name].model_fields_set:
                raise WmrError("bounds estimates that nothing adapts", "add adaptation, or leave it out")
            projection = self._projection(table, estimate, thetas)
            if adaptation is not None:
                projection.check(estimate, thetas)
        with self.at(place("input_weights")):
            law = LinearizingLaw(len(model.input_units), table.input_weights)
        with self.at(place("robust")):
            robust = None if table.robust is None else RobustTerm(**table.robust.model_dump())
        with self.at(f"[controllers.{name}]"):
            known = model.known(self.parameters)
            return TrackingController(model, known, estimate, outer_loop, law, adaptation, projection, robust)

    def _projection(self, table: ControllerTable, estimate: Vector, thetas: list[str]) -> Projection:
        def bounds(given: float | dict[str, float] | None, open_end: float) -> Vector:
            if given is None:
                return np.full(len(thetas), open_end)
            if isinstance(given, dict):
                return by_name("base parameter", given, thetas, missing=open_end)
            guarded: list[str] = self.model.findings["determinant_parameters"]
            return np.array([given if theta in guarded else open_end for theta in thetas])

        if table.projection is None:
            return Projection(len(thetas))
        if table.projection.relative is not None:
            return Projection(len(thetas), *relative_bounds(table.projection, estimate))
        return Projection(len(thetas), bounds(table.projection.lower, -np.inf), bounds(table.projection.upper, np.inf))


def _adaptation(table: AdaptationTable, estimate: Vector, thetas: list[str]) -> GradientAdaptation:
    leakage = None
    if table.leakage is not None:
        missing = 0.0 if isinstance(table.leakage, dict) else None
        leakage = Leakage(len(thetas), by_name("base parameter", table.leakage, thetas, missing))
    normalization = None if table.normalization is None else Normalization(table.normalization)
    gain = adaptation_gain(table, estimate, thetas)
    return GradientAdaptation(len(thetas), gain, leakage, normalization, table.input == "applied")
