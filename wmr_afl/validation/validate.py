"""A generated model against the engine: accelerations at random states, one drive, a verdict with its bounds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.errors import InputError, WmrError
from wmr_afl.model.files import is_shipped
from wmr_afl.model.model import Model, load_model
from wmr_afl.model.plausibility import check_robots
from wmr_afl.numerics.arguments import checked
from wmr_afl.numerics.arrays import Floats
from wmr_afl.validation.bursts import Bursts, bursts
from wmr_afl.validation.drive import Driven, drive
from wmr_afl.validation.engine import mujoco
from wmr_afl.validation.mechanism import Mechanism
from wmr_afl.validation.mjcf import Contact, xml_of

CONVENTIONAL, SWEDISH = 4e-5, 1e-3  # root mean square of accelerations' errors: rollers rub a little in the engine
RUN = 1e-3  # of a drive, extrapolated
SLIPS = 0.95  # of the friction that there is: with more the engine's wheels slip
SPREAD = 0.35  # of the logarithm of drawn parameters


@dataclass(frozen=True, repr=False)
class Validation:
    """One robot at one set of parameters p (n_p,)."""

    mechanism: Mechanism
    bursts: Bursts
    driven: Driven
    bound: float  # of the bursts

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
        found = (self.bursts.rms.max() <= self.bound, self.differences[2].max() <= RUN, self.ends[2] <= RUN)
        return bool(all(found))

    @property
    def verdict(self) -> str:
        """In a line, with the bounds."""
        word = "AGREES" if self.agrees else "DIFFERS"
        return (
            f"{word}: accelerations at random states within {100 * self.bound:g} % rms "
            f"({100 * self.bursts.rms.max():.2g} %), the drive within {100 * RUN:g} % "
            f"({100 * max(self.differences[2].max(), self.ends[2]):.2g} %)"
        )

    @property
    def friction(self) -> dict[str, float]:
        """What the drive needed at each wheel, as a share of its load."""
        return dict(zip((wheel.name for wheel in self.mechanism.wheels), self.driven.friction.tolist(), strict=True))

    @property
    def xml(self) -> str:
        """The engine's robot, for any viewer of MuJoCo."""
        start = self.driven.model[0, : self.model.coordinate_count]
        return xml_of(self.mechanism, self.mechanism.loads(start), Contact())

    @property
    def numbers(self) -> dict[str, Any]:
        """Everything that was measured, ready for JSON."""
        return {
            "robot": self.model.name,
            "engine": f"MuJoCo {mujoco().__version__}",
            "agrees": self.agrees,
            "parameters": dict(zip(self.model.parameter_units, self.mechanism.p.tolist(), strict=True)),
            "bursts": {
                "bound": self.bound,
                "count": self.bursts.count,
                "slipped": self.bursts.slipped,
                "rms": dict(zip(self.names, self.bursts.rms.tolist(), strict=True)),
                "worst": dict(zip(self.names, self.bursts.worst.tolist(), strict=True)),
            },
            "drive": {
                "bound": RUN,
                "seconds": float(self.driven.time[-1]),
                **{
                    key: dict(zip(self.names, row.tolist(), strict=True)) | {"end of the path": float(end)}
                    for key, row, end in zip(
                        ("coarse", "fine", "extrapolated"), self.differences, self.ends, strict=True
                    )
                },
                "friction": self.friction,
            },
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
) -> Validation:
    """Hold a model against MuJoCo, which is told frames, masses, wheels and motors, and nothing of constraints.

    `parameters` replace the description's; `start` is where the drive begins, zero unless given. `count` random states
    are drawn with `seed`; the drive lasts `seconds` [s].

    Raises:
        WmrError: if the engine is not installed or cannot have the robot, or if wheels would slip in it.
        InputError: if `count`, `seconds`, `seed` or `start` is wrong.
        UnknownNameError: if a parameter has another name.
    """
    model = (robot if isinstance(robot, Model) else load_model(robot)).in_library("numpy")
    p = np.asarray(model.parameters(**(parameters or {})), dtype=float)
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
    mechanism = Mechanism(model, p)
    found = bursts(mechanism, count=count, seed=seed)
    if found.slipped == count:
        raise WmrError("every random state needs more friction than there is", "choose heavier wheels or other motors")
    q = np.array([float((start or {}).get(name, 0.0)) for name in names])
    driven = drive(mechanism, q, seconds)
    least = Contact().friction * SLIPS
    if driven.friction.max() > least:
        worst = mechanism.wheels[int(driven.friction.argmax())].name
        problem = f"the drive needs {driven.friction.max():.2g} of the load in friction at wheel {worst}: it slips"
        raise WmrError(problem, "agreement would mean nothing; start elsewhere, or look at the masses at this wheel")
    is_exact = is_shipped(model.folder) and not mechanism.has_rollers
    return Validation(mechanism, found, driven, CONVENTIONAL if is_exact else SWEDISH)


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
