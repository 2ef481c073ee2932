"""Experiment tables -> the objects of a closed loop, with every mistake reported where it stands in the file."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wmr_afl.controllers import reference
from wmr_afl.controllers.adaptation import GradientAdaptation
from wmr_afl.controllers.direct_adaptation import DirectAdaptation
from wmr_afl.controllers.groups import groups_of
from wmr_afl.controllers.kalman_observer import KalmanObserver
from wmr_afl.controllers.law import Knowledge, Law
from wmr_afl.controllers.least_squares import LeastSquares
from wmr_afl.controllers.linearizing_law import LinearizingLaw
from wmr_afl.controllers.observer import Observer, ObserverTable
from wmr_afl.controllers.outer_loop import OuterLoop
from wmr_afl.controllers.passivity_law import Effort, PassivityLaw
from wmr_afl.controllers.path import along
from wmr_afl.controllers.pieces import Pieces
from wmr_afl.controllers.pose_observer import Cancelling, PoseObserver
from wmr_afl.controllers.projection import Projection
from wmr_afl.controllers.reference import PathTable, Reference, ReferenceTable, TrajectoryTable, WaypointsTable
from wmr_afl.controllers.reference_model import ReferenceModel
from wmr_afl.controllers.robust_term import RobustTerm
from wmr_afl.controllers.sight import Sight
from wmr_afl.controllers.slip_meter import SlipMeter
from wmr_afl.controllers.tables import KAPPA, LINEARIZING, PASSIVE, ControllerTable
from wmr_afl.controllers.tracking_law import TrackingLaw
from wmr_afl.controllers.under_way import CommandsUnderWay
from wmr_afl.controllers.waypoints import Waypoints
from wmr_afl.errors import UnknownNameError, WmrError
from wmr_afl.experiments.experiment import Experiment
from wmr_afl.model.files import model_folder
from wmr_afl.model.measurement import Measurement
from wmr_afl.model.model import Model, load_model
from wmr_afl.model.observability import remedies, undetermined
from wmr_afl.model.plausibility import check_robots, check_start
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.rules import Numbers, Rules
from wmr_afl.numerics.vectors import by_name
from wmr_afl.plant.plant import Plant
from wmr_afl.plant.uncertainty import Surroundings
from wmr_afl.simulation.closed_loop import ClosedLoop
from wmr_input.errors import mistakes_at

FEWEST = 10.0  # samples in the memory of least squares
SLOWER_SLIP = 4.0  # times than the rest of what is observed slip is thought to change


def assemble(experiment: Experiment, file: Path) -> dict[str, ClosedLoop]:
    """The closed loop of every controller of the experiment in `file`.

    Raises:
        InputError: if a value does not fit the robot; the text names file, place and remedy.
    """
    assembly = _Assembly(experiment, file)
    return {name: assembly.loop(name) for name in experiment.controllers}


def model_of(experiment: Experiment, file: Path) -> Path:
    """The folder of an experiment's model: a shipped one by its name, one beside its file, or one by its path.

    Raises:
        InputError: if there is no such model.
    """
    with mistakes_at(file, "robot"):
        return model_folder(experiment.robot, file.parent)


def rules_of(experiment: Experiment, controller: str, model: Model) -> Rules:
    """How numbers of one of an experiment's closed loops follow from others."""
    return {**experiment.uncertainties.rules(model), **experiment.controller(controller).rules(model)}


@dataclass
class _Assembly:
    """Model, parameters and reference of an experiment, which its closed loops share."""

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
        plant = self._plant()
        law = self._law(name, self.experiment.controller(name))
        return ClosedLoop(self.model, plant, law, self.reference, self.experiment.simulation.sample_time)

    def _plant(self) -> Plant:
        simulation, model = self.experiment.simulation, self.model
        surroundings = Surroundings(model, self.parameters, simulation.sample_time)
        uncertainties = self.experiment.uncertainties.build(surroundings, self.at)
        with self.at("[start]"):
            check_start(model, self.experiment.start, self.parameters)
            start = by_name("state", self.experiment.start, list(model.state_units), missing=0.0)
            return Plant(model, self.parameters, start, simulation.integrator, uncertainties)

    def _reference(self, table: ReferenceTable) -> Reference:
        if table.pieces is None:
            return self._trajectory(table, table.counts_turns, "[reference.{}]")
        pieces: list[Reference | tuple[Reference, float]] = []
        for number, piece in enumerate(table.pieces, start=1):
            one = self._trajectory(piece, table.counts_turns, f"[reference] pieces number {number} {{}}")
            pieces.append(one if piece.duration is None else (one, piece.duration))
        with self.at("[reference.pieces]"):
            return Pieces(pieces) if table.stop is None else Pieces(pieces, table.stop)

    def _trajectory(self, table: TrajectoryTable, counts_turns: bool, place: str) -> Reference:
        """The reference of a table, whose points stand in it by now; `place` in the file, of any kind."""
        outputs = list(self.model.output_units)
        kind, given = next((kind, value) for kind, value in table.kinds().items() if value is not None)
        with self.at(place.format(kind)):
            if table.expressions is not None:
                return Reference(table.expressions, counts_turns).ordered(outputs)
            if table.waypoints is not None:
                return self._waypoints(table.waypoints, counts_turns).ordered(outputs)
            if table.path is not None:
                return self._path(table.path, counts_turns)
            expressions: list[str] = getattr(reference, kind)(**given.model_dump())
            if len(expressions) != len(outputs):
                raise WmrError(
                    f"gives {len(expressions)} coordinates for {len(outputs)} outputs ({', '.join(outputs)})",
                    "write [reference.expressions]",
                )
            return Reference(dict(zip(outputs, expressions, strict=True)), counts_turns)

    def _waypoints(self, table: WaypointsTable, counts_turns: bool) -> Waypoints:
        columns = dict(table.points or {})
        if "t" not in columns:
            raise WmrError("points have no times", "add a column t [s], or give a path instead")
        times = columns.pop("t")
        return Waypoints(times, columns, table.between, table.ends, table.stop, counts_turns)

    def _path(self, table: PathTable, counts_turns: bool) -> Waypoints:
        given = table.points or {}
        columns = {name: given.get(name, []) for name in self.model.output_units}
        unknown = [name for name in given if name not in columns]
        if unknown:
            raise UnknownNameError("output", unknown[0], list(columns))
        limits = table.speed, table.acceleration, table.lateral, table.jerk
        return along(columns, *limits, counts_turns=counts_turns)

    def _law(self, name: str, table: ControllerTable) -> Law:
        def place(key: str) -> str:
            return self.experiment.place(name, key)

        foreign = PASSIVE if table.law == "linearizing" else LINEARIZING
        if table.law == "frozen":
            foreign = (*foreign, "learning")
        for key in foreign:
            if key in self.experiment.controllers[name].model_fields_set:
                with self.at(place(key)):
                    raise WmrError(f"means nothing to the {table.law} law", f"remove {key}, or choose another law")
        with self.at(place("guess")):
            if table.guess and table.estimate != "exact":
                raise WmrError("stands beside an estimate", "give one of them")
            for parameter in table.guess:
                if parameter in self.model.known_units:
                    raise WmrError(f"the controller knows {parameter}", "guess uncertain parameters")
            check_robots(self.model, self.experiment.start, self.model.replaced(self.parameters, table.guess))
        build = self._linearizing if table.law == "linearizing" else self._passivity
        return build(name, table, place)

    def _knowledge(self, name: str, table: ControllerTable, place: Callable[[str], str]) -> tuple[Knowledge, Numbers]:
        """What the controller knows, and the numbers that follow from that."""
        model = self.model
        with self.at(f"[controllers.{name}]"):
            if table.law != "linearizing" and not model.has("passivity_regressor"):
                obstacle = model.metadata["passivity_obstacle"]
                raise WmrError(
                    f"model {model.name} admits no {table.law} law: {obstacle}", "or use the linearizing law"
                )
        with self.at(place("guess" if table.guess else "estimate")):
            given = {"p": self.parameters, "x": by_name("state", self.experiment.start, list(model.state_units), 0.0)}
            numbers = Numbers(rules_of(self.experiment, name, model), given)
            if not np.all(np.isfinite(numbers["theta_hat"])):
                raise WmrError("gives base parameters that are not finite", "guess values that a robot can have")
            return Knowledge(model, numbers["c"], numbers["theta_hat"], table.estimated), numbers

    def _passivity(self, name: str, table: ControllerTable, place: Callable[[str], str]) -> PassivityLaw:
        knowledge, numbers = self._knowledge(name, table, place)
        model, learning, groups = self.model, table.learning, groups_of(self.model)
        limits = self.experiment.uncertainties.input_limits
        limit = table.limit or (None if limits is None else float(np.min(limits.volts)))
        with self.at(place("input_weights")):
            effort = Effort(len(model.input_units), table.input_weights, limit)
        with self.at(place("guess" if table.guess else "estimate")):
            direct = least_squares = projection = None
            if table.law != "frozen":
                # What integrates, integrates once: beside an observer least squares alone learn, unless told otherwise.
                if table.law == "direct" or table.observing is None or learning.gain is not None:
                    gain = learning.gain or KAPPA[table.law]
                    direct = DirectAdaptation(groups, gain, numbers["direct.inertia"], numbers["direct.spread"])
                projection = Projection(
                    len(knowledge.theta_hat), numbers["projection.lower"], numbers["projection.upper"]
                )
            if table.law == "composite":
                prior = numbers["least_squares.prior"], numbers["least_squares.spread"]
                numbers_given = (table.noise, learning.filter, learning.memory)
                least_squares = LeastSquares(groups, len(model.input_units), *prior, *numbers_given)
        step, late = self.experiment.simulation.sample_time, self.experiment.uncertainties.input_delay
        with self.at(place("learning")):
            if table.law == "composite" and learning.memory < FEWEST * step:
                raise WmrError(
                    f"memory = {learning.memory:g} s is no window of samples", f"choose {FEWEST * step:g} or more"
                )
        rates = table.rates(step, 0.0 if late is None else late.seconds)
        with self.at(f"[controllers.{name}]"):
            sight = self._sight(table, numbers)
            return PassivityLaw(knowledge, *rates, effort, direct, least_squares, projection, sight)

    def _sight(self, table: ControllerTable, numbers: Numbers) -> Sight:
        """What looks at what is measured, and what is made of it."""
        given, step = table.observing, self.experiment.simulation.sample_time
        if given is None:
            return Sight()
        outputs, late = len(self.model.output_units), self.experiment.uncertainties.input_delay
        if given.predict and (late is None or table.law == "linearizing"):
            why = (
                "the drive is not late" if late is None else "the linearizing law expects what the applied voltages do"
            )
            raise WmrError(f"predict means nothing: {why}", "remove predict")
        observer = self._observer(table, given, numbers)
        cancelling = Cancelling(outputs, given.start, given.ramp, given.band, given.separate) if given.cancel else None
        under_way = None
        if late is not None and table.law != "linearizing":  # that law expects what the applied voltages do
            under_way = CommandsUnderWay(outputs, round(late.seconds / step), step, given.predict)
        return Sight(observer, cancelling, under_way, self._slip_meter(table, numbers))

    def _slip_meter(self, table: ControllerTable, numbers: Numbers) -> SlipMeter | None:
        """What reads slip, where all of q is measured and something can slip."""
        sees = Measurement(self.model, table.entries_measured(self.model))
        if not sees.tells_q:
            return None
        rate = table.slip_rate(self.experiment.simulation.sample_time)
        meter = SlipMeter(self.model, numbers["slip.p"], rate, sees.tells_v)
        return meter if meter.names else None

    def _observer(self, table: ControllerTable, given: ObserverTable, numbers: Numbers) -> Observer:
        """Of the pose, or of whatever is measured, which then has to determine the state."""
        model, rate = self.model, table.observer_rate(self.experiment.simulation.sample_time)
        measured = table.entries_measured(model)
        if not table.is_kalman(model):
            for key in ("deviation", "slip", "carried", "first"):
                if key in given.model_fields_set:
                    raise WmrError(f"observer.{key} means nothing where the pose is measured", 'add kind = "kalman"')
            sees = Measurement(model, measured)
            pose = list(model.state_units)[: model.coordinate_count]
            if set(measured) not in (set(pose), set(model.state_units)):
                raise WmrError(
                    'observer.kind "pose" needs all of q, or of x, and nothing else', 'write kind = "kalman"'
                )
            return PoseObserver(
                len(model.output_units), rate, sees.tells_v, given.bound, None if table.knows_v else sees
            )
        coordinates = list(model.state_units)[: model.coordinate_count]
        for key, names in (("carried", given.carried), ("first", list(given.first))):
            for n, name in enumerate(names):
                if name not in coordinates or name in measured or name in names[:n]:
                    raise WmrError(f"observer.{key} names {name}", "name coordinates that are not measured, once")
        p = numbers["observer.p"]
        sees = Measurement(model, measured)
        slip_rate = None
        if given.slip and sees.tells_q:
            slip_rate = given.slip_rate or rate / SLOWER_SLIP
        elif given.slip_rate is not None and not sees.tells_q:
            raise WmrError("observer.slip_rate means nothing where q is measured in part", "remove it, or measure q")
        observer = KalmanObserver(model, sees, rate, p, given.deviation, given.first, given.bound, slip_rate)
        unseen = undetermined(model, measured, p)
        carried_by_motion = set(unseen) <= set(coordinates)  # where a rate is left, nothing tells how they are carried
        left = unseen if not carried_by_motion else [name for name in unseen if name not in given.carried]
        if left:
            remedy = f"measure {', or '.join(' and '.join(names) for names in remedies(model, measured, p))}, too"
            if carried_by_motion:
                remedy += f", or let the motion carry along what nothing tells: observer.carried = {list(unseen)}"
            raise WmrError(f"nothing of {', '.join(measured)} determines {', '.join(left)}", remedy)
        return observer

    def _linearizing(self, name: str, table: ControllerTable, place: Callable[[str], str]) -> TrackingLaw:
        model = self.model
        with self.at(place("outer_loop")):
            if table.outer_loop is None:
                raise WmrError("is missing", "add outer_loop = { b1 = ..., b2 = ... } here or under [shared]")
            gains = table.outer_loop.gains(self.experiment.simulation.sample_time)
            outer_loop = OuterLoop(len(model.output_units), *gains, table.outer_loop.alpha)
        knowledge, numbers = self._knowledge(name, table, place)
        adaptation = self._adaptation(name, table, numbers)
        with self.at(place("input_weights")):
            linearizing = LinearizingLaw(len(model.input_units), table.input_weights)
        with self.at(place("robust")):
            robust = None if table.robust is None else RobustTerm(**table.robust.model_dump())
        with self.at(f"[controllers.{name}]"):
            rate, outputs = table.reference_rate, len(model.output_units)
            reference_model = None if rate is None else ReferenceModel(outputs, rate)
            return TrackingLaw(
                knowledge, outer_loop, linearizing, adaptation, robust, reference_model, self._sight(table, numbers)
            )

    def _adaptation(self, name: str, table: ControllerTable, numbers: Numbers) -> GradientAdaptation | None:
        thetas = list(self.model.base_parameter_units)
        with self.at(self.experiment.place(name, "projection")):
            projection = self._projection(table, numbers)
            if table.adaptation is None:
                if "projection" in self.experiment.controllers[name].model_fields_set:
                    raise WmrError("bounds estimates that nothing adapts", "add adaptation, or leave it out")
                return None
        with self.at(self.experiment.place(name, "adaptation")):
            given = table.adaptation.gain
            if table.adaptation.relative_gain is not None:
                gain: Any = numbers["adaptation.Gamma"]
            else:
                gain = by_name("base parameter", given, thetas) if isinstance(given, dict) else given
            modifications = table.adaptation.modifications(thetas)
            seen = table.adaptation.input == "applied"
            is_late = table.adaptation.order == "late"
            adaptation = GradientAdaptation(len(thetas), gain, modifications, projection, seen, is_late)
        with self.at(self.experiment.place(name, "projection")):
            projection.check(numbers["theta_hat"], thetas)
        return adaptation

    def _projection(self, table: ControllerTable, numbers: Numbers) -> Projection:
        thetas = list(self.model.base_parameter_units)

        def bounds(given: float | dict[str, float] | None, open_end: float) -> Floats:
            if given is None:
                return np.full(len(thetas), open_end)
            if isinstance(given, dict):
                return by_name("base parameter", given, thetas, missing=open_end)
            guarded: list[str] = self.model.findings["determinant_parameters"]
            return np.array([given if theta in guarded else open_end for theta in thetas])

        if table.projection is None:
            return Projection(len(thetas))
        if table.projection.relative is not None:
            return Projection(len(thetas), numbers["projection.lower"], numbers["projection.upper"])
        return Projection(len(thetas), bounds(table.projection.lower, -np.inf), bounds(table.projection.upper, np.inf))
