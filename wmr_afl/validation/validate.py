"""A generated model against the engine: accelerations at random states, one drive, a verdict with its bounds."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.errors import InputError, WmrError
from wmr_afl.experiments.load import load_experiment
from wmr_afl.model.files import is_shipped
from wmr_afl.model.model import Model, load_model
from wmr_afl.model.plausibility import check_robots
from wmr_afl.numerics.arguments import checked
from wmr_afl.numerics.arrays import Floats
from wmr_afl.simulation.closed_loop import ClosedLoop
from wmr_afl.validation.bursts import Bursts, bursts
from wmr_afl.validation.drive import Driven, drive
from wmr_afl.validation.engine import Watch, mujoco
from wmr_afl.validation.mechanism import Mechanism
from wmr_afl.validation.mjcf import Contact, xml_of
from wmr_afl.validation.tracking import Tracked, track


@dataclass(frozen=True)
class Bounds:
    """Of what may lie between a model and the engine."""

    bursts: float  # root mean square of accelerations' errors
    loop: float  # of what a controller brings about, extrapolated: it makes up for most of what differs
    drive: float = 1e-3  # of velocities and of the path, extrapolated


CONVENTIONAL = Bounds(4e-5, 1e-5)
ROUGH = Bounds(1e-3, 1e-4)  # rollers rub a little in the engine; robots of one's own come near singular states
SPREAD = 0.35  # of the logarithm of drawn parameters
Progress = Callable[[int, int], None]  # checks done, of how many


@dataclass(frozen=True, repr=False)
class Validation:
    """One robot at one set of parameters p (n_p,)."""

    mechanism: Mechanism
    bursts: Bursts
    driven: Driven
    bounds: Bounds
    tracked: tuple[Tracked, ...] = ()  # controllers of an experiment
    height: float | None = None  # [m] of the masses, in space

    @property
    def model(self) -> Model:
        """The generated model."""
        return self.mechanism.model

    @property
    def names(self) -> list[str]:
        """Pseudo-velocities."""
        return list(self.model.state_units)[self.model.coordinate_count :]

    @property
    def differences(self) -> Floats:
        """(3, n-m), of the drive: with the coarse step, the fine one, and extrapolated."""
        return self.driven.differences(self.model.coordinate_count)

    @property
    def ends(self) -> Floats:
        """(3,), how far apart the root's paths end, as a share of its path."""
        return self.driven.ends(self.place)

    @property
    def agrees(self) -> bool:
        """Whether everything is within its bound."""
        found = (
            self.bursts.rms.max() <= self.bounds.bursts,
            self.differences[2].max() <= self.bounds.drive,
            self.ends[2] <= self.bounds.drive,
        )
        return bool(all(found)) and all(one.share <= self.bounds.loop for one in self.tracked)

    @property
    def verdict(self) -> str:
        """In a line, with the bounds."""
        parts = [
            ("accelerations at random states", float(self.bursts.rms.max()), self.bounds.bursts),
            ("the drive", float(max(self.differences[2].max(), self.ends[2])), self.bounds.drive),
        ]
        if self.tracked:
            worst = max(one.share for one in self.tracked)
            parts.append(("what controllers bring about", worst, self.bounds.loop))
        told = (f"{what} by {100 * share:.2g} % (bound {100 * bound:g} %)" for what, share, bound in parts)
        return f"{'AGREES' if self.agrees else 'DIFFERS'}: {', '.join(told)}"

    @property
    def wheels(self) -> dict[str, dict[str, float]]:
        """Of each wheel: its load at rest, the least and the most on the way [N], and the friction that was needed.

        In space loads shift; in the plane they are those of statics.
        """
        rest = self.mechanism.loads(self.driven.model[0, : self.model.coordinate_count])
        grip = self.driven.grip
        for one in self.tracked:
            grip = grip.beside(one.grip)
        rows = np.array([rest, grip.least, grip.most, grip.friction]).T.tolist()
        names = (wheel.name for wheel in self.mechanism.wheels)
        columns = "rest", "least", "most", "friction"
        return {name: dict(zip(columns, row, strict=True)) for name, row in zip(names, rows, strict=True)}

    @property
    def friction(self) -> dict[str, float]:
        """The most that was needed at each wheel, as a share of its load at that time."""
        return {name: numbers["friction"] for name, numbers in self.wheels.items()}

    @property
    def xml(self) -> str:
        """The engine's robot, for any viewer of MuJoCo."""
        start = self.driven.model[0, : self.model.coordinate_count]
        return xml_of(self.mechanism, self.mechanism.loads(start), Contact(), self.height)

    @property
    def numbers(self) -> dict[str, Any]:
        """Everything that was measured, ready for JSON."""
        return {
            "robot": self.model.name,
            "engine": f"MuJoCo {mujoco().__version__}",
            "agrees": self.agrees,
            "parameters": dict(zip(self.model.parameter_units, self.mechanism.p.tolist(), strict=True)),
            "bursts": {
                "bound": self.bounds.bursts,
                "count": self.bursts.count,
                "slipped": self.bursts.slipped,
                "rms": dict(zip(self.names, self.bursts.rms.tolist(), strict=True)),
                "worst": dict(zip(self.names, self.bursts.worst.tolist(), strict=True)),
            },
            "drive": {
                "bound": self.bounds.drive,
                "seconds": float(self.driven.time[-1]),
                **{
                    key: dict(zip(self.names, row.tolist(), strict=True)) | {"end of the path": float(end)}
                    for key, row, end in zip(
                        ("coarse", "fine", "extrapolated"), self.differences, self.ends, strict=True
                    )
                },
            },
            "space": None if self.height is None else {"height": self.height},
            "wheels": self.wheels,
            "controllers": {one.controller: self._of(one) for one in self.tracked},
        }

    def _of(self, one: Tracked) -> dict[str, Any]:
        outputs = list(self.model.output_units)
        errors = {
            key: dict(zip(outputs, row.tolist(), strict=True))
            for key, row in zip(("simulated", "coarse", "fine", "extrapolated"), one.errors, strict=True)
        }
        apart = {
            key: dict(zip(outputs, row.tolist(), strict=True))
            for key, row in zip(("coarse", "fine", "extrapolated"), one.apart, strict=True)
        }
        return {
            "bound": self.bounds.loop,
            "share": one.share,
            "errors": errors,
            "apart": apart,
            "left_out": list(one.left_out),
        }

    def __repr__(self) -> str:
        return f"<Validation {self.model.name}: {self.verdict}>"

    def place(self, states: Floats) -> Floats:
        """Where the root is (T, 2) [m] at states (T, 2n-m)."""
        return np.array([self.mechanism.place(x[: self.model.coordinate_count])[0].full()[:2, 0] for x in states])


@checked
def validate(
    robot: str | Path | Model,
    *,
    parameters: Mapping[str, ArrayLike] | None = None,
    start: Mapping[str, float] | None = None,
    count: int = 200,
    seconds: float = 10.0,
    seed: int = 1,
    experiment: str | Path | None = None,
    controllers: Iterable[str] | str | None = None,
    space: bool = False,
    height: float | None = None,
    progress: Progress = lambda done, total: None,
    watch: Watch = lambda engine, time: None,
) -> Validation:
    """Hold a model against MuJoCo, which is told frames, masses, wheels and motors, and nothing of constraints.

    `parameters` replace the description's; `start` is where the drive begins, zero unless given. `count` random states
    are drawn with `seed`; the drive lasts `seconds` [s]. With an `experiment` of this robot its controllers, or those
    that are named, drive the engine's robot besides, at the experiment's parameters and from its start.

    With `space` the robot may rise, pitch and roll on its wheels, with all masses at `height` [m] above the floor, the
    radius of its largest wheel unless given. `watch` is called with the engine while it drives.

    Raises:
        WmrError: if the engine is not installed or cannot have the robot, wheels would slip or leave the floor, or the
            experiment is one of another robot.
        InputError: if `count`, `seconds`, `seed`, `height` or `start` is wrong, or the experiment's file.
        UnknownNameError: if a parameter, an experiment or a controller has another name.
    """
    model = (robot if isinstance(robot, Model) else load_model(robot)).in_library("numpy")
    p = np.asarray(model.parameters(**(parameters or {})), dtype=float)
    if p.ndim != 1:
        raise InputError(
            "parameters", f"{dict(parameters or {})}", "are those of several robots", "validate one by one"
        )
    check_robots(model, {}, p)
    if not 1 <= count <= 10_000 or not 0.1 <= seconds <= 60.0:
        wrong = ("count", f"{count}") if not 1 <= count <= 10_000 else ("seconds", f"{seconds:g}")
        raise InputError(*wrong, "is too little or too much", "choose 1 to 10000 states, and 0.1 to 60 s")
    if seed < 0:
        raise InputError("seed", f"{seed}", "is no seed", "choose 0 or more")
    names = list(model.state_units)[: model.coordinate_count]
    unknown = sorted(set(start or {}) - set(names))
    if unknown:
        raise InputError("start", unknown[0], "is no coordinate", f"name one of {', '.join(names)}")
    if height is not None and not (space and 1e-3 <= height <= 100.0):
        what = "is no height" if space else "is given without space"
        raise InputError("height", f"{height:g}", what, "give 0.001 to 100 m of the masses, in space")
    if experiment is not None and (parameters or start):
        given = "parameters" if parameters else "start"
        raise InputError(
            given, ", ".join(parameters or start or ()), "stand in the experiment", "leave one of both out"
        )
    if not all(np.isfinite(float(value)) for value in (start or {}).values()):
        raise InputError("start", f"{dict(start or {})}", "is not finite", "give finite numbers")
    mechanism, loops = Mechanism(model, p), _loops(experiment, controllers, model)
    above = (height or mechanism.axle_height) if space else None
    total = 2 + len(loops)
    progress(0, total)
    found = bursts(mechanism, count=count, seed=seed)
    if found.slipped == count:
        raise WmrError("every random state needs more friction than there is", "choose heavier wheels or other motors")
    q = np.array([float((start or {}).get(name, 0.0)) for name in names])
    progress(1, total)
    driven = drive(mechanism, q, seconds, above, None if loops else watch)
    tracked: list[Tracked] = []
    for name, (loop, duration) in loops.items():
        progress(2 + len(tracked), total)
        tracked.append(track(loop, name, duration, above, None if tracked else watch))
    progress(total, total)
    is_exact = is_shipped(model.folder) and not mechanism.has_rollers and _is_near(p, model)
    bounds = CONVENTIONAL if is_exact else ROUGH
    return Validation(mechanism, found, driven, bounds, tuple(tracked), above)


def _is_near(p: Floats, model: Model) -> bool:
    """Whether parameters are as far from the description's as those that are drawn."""
    described = np.asarray(model.parameters(), dtype=float)
    return bool(np.all(np.abs(p - described) <= np.expm1(SPREAD) * np.abs(described)))


def _loops(
    experiment: str | Path | None, controllers: Iterable[str] | str | None, model: Model
) -> dict[str, tuple[ClosedLoop, float]]:
    """Closed loops of an experiment by controller, with their duration [s]."""
    if experiment is None:
        if controllers is not None:
            raise InputError("controllers", f"{controllers}", "stand in an experiment", "name the experiment, too")
        return {}
    loaded = load_experiment(experiment)
    chosen = [controllers] if isinstance(controllers, str) else list(() if controllers is None else controllers)
    found = {}
    for name in (loaded.name(one) for one in chosen or loaded.loops):
        loop = loaded.loops[name]
        if loop.model.folder != model.folder:
            problem = f"{loaded.path.stem} is an experiment of {loop.model.name}, not of {model.name}"
            raise WmrError(problem, "name one of this robot")
        found[name] = loop, loaded.experiment.simulation.duration
    return found


def drawn(model: Model, count: int, seed: int = 1) -> list[dict[str, float]]:
    """Sets of parameters about the description's, by a factor each; robots that cannot be are drawn again."""
    random, found = np.random.default_rng(seed), []
    names, p = list(model.parameter_units), np.asarray(model.parameters(), dtype=float)
    for _ in range(100 * count):
        other = p * np.exp(random.uniform(-SPREAD, SPREAD, len(p)))
        try:
            check_robots(model, {}, other)
        except WmrError:
            continue
        found.append(dict(zip(names, other.tolist(), strict=True)))
        if len(found) == count:
            break
    return found
