"""What a law goes by: the state as it is measured, or what an observer makes of the pose and of commands under way."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

from wmr_afl.controllers.observer import Observer, Seen
from wmr_afl.controllers.outer_loop import TrackingError, tracking_error
from wmr_afl.controllers.pose_observer import Cancelling
from wmr_afl.controllers.reference import Point
from wmr_afl.controllers.slip_meter import SeenSlip, SlipMeter
from wmr_afl.controllers.under_way import CommandsUnderWay
from wmr_afl.errors import MissingTermError
from wmr_afl.model.measurement import Measurement
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array
from wmr_afl.numerics.linear_algebra import solve
from wmr_afl.numerics.parts import Part, prefixed

# Of a command: v' that it is to bring about, and what is kept out of the data, (n-m,) each.
Asked = tuple[Array, Array]


@dataclass(frozen=True)
class View:
    """One sample: the state now, the one that the command will meet, and what is to be cancelled."""

    now: Array  # (2n-m,)
    x: Array  # when the command acts, (2n-m,): `now` unless that is predicted
    seen: Seen | None = None
    ahead: Seen | None = None
    cancelled: Array | None = None  # g E^-1 d^ (n-m,) [of v']
    fast: Array | None = None  # of it what is kept out of the data
    slip: SeenSlip | None = None

    @property
    def E(self) -> Array | None:
        """Output map J_h S at q, (n-m, n-m), if an observer needed it."""
        return None if self.seen is None else self.seen.E

    @property
    def unexpected(self) -> Array:
        """d^ (n-m,) [output units/s^2]; only where there is an observer."""
        return None if self.seen is None else self.seen.unexpected

    @property
    def surprise(self) -> Array:
        """By how much this sample differs from what was expected [m, rad]; only where there is an observer."""
        return None if self.seen is None else self.seen.surprise

    def error(self, reference: Point, c: Array, model: Model) -> TrackingError:
        """y - yr and its rate, where the command acts."""
        if self.ahead is None:
            return tracking_error(self.x, c, reference, model)
        return self.ahead.error(reference, model)


class Sight:
    """The parts that look: none of them where the state is measured and nothing is cancelled.

    Raises:
        MissingTermError: if something is to be cancelled or predicted that no observer sees.
    """

    def __init__(
        self,
        observer: Observer | None = None,
        cancelling: Cancelling | None = None,
        under_way: CommandsUnderWay | None = None,
        slip: SlipMeter | None = None,
    ) -> None:
        if observer is None and not (cancelling is None and under_way is None and slip is None):
            raise MissingTermError("only an observer tells what to cancel, and where commands lead", "add one")
        self.observer, self.cancelling, self.under_way, self.slip = observer, cancelling, under_way, slip
        self.parts: tuple[Part | None, ...] = (observer, cancelling, under_way, slip)

    @property
    def slip_names(self) -> tuple[str, ...]:
        """What slips of what is measured."""
        return () if self.slip is None else self.slip.names

    @property
    def measurement(self) -> Measurement | None:
        """What it looks at; None is x as it is measured."""
        return None if self.observer is None else self.observer.measurement

    @property
    def lead(self) -> float:
        """How much later than now [s] the reference counts."""
        return 0.0 if self.under_way is None or not self.under_way.predicts else self.under_way.seconds

    def sound(self, view: View, k: SimpleNamespace) -> list[Array]:
        """Nothing, or a number that is positive as long as the observer is not lost."""
        return [] if view.seen is None else [k.observer.bound[0] - view.seen.surprise]

    def look(self, x: Array, z: SimpleNamespace, k: SimpleNamespace, model: Model, step: Array) -> View:
        """What the measured x (2n-m,), or z of the measurement, tells."""
        if self.observer is None:
            return View(x, x)
        arrays = model.arrays
        seen = ahead = self.observer.see(x, z.observer, k.observer, k.c, model, step)
        E = seen.E
        if self.under_way is not None:
            ahead = self.under_way.ahead(seen, E, _drift(seen.x, k.c, model), z.under_way, arrays, step)
        cancelled = fast = None
        if self.cancelling is not None:
            unexpected = solve(E, seen.unexpected, arrays)
            cancelled = self.cancelling.cancelled(unexpected, z.cancelling, k.cancelling, arrays)
            fast = self.cancelling.fast(cancelled, z.cancelling)
        slip = None
        if self.slip is not None:
            state = x if self.measurement is None else self.measurement.state(x, k.slip.p, model)
            slip = self.slip.see(state, z.slip, k.slip, model, step)
        return View(seen.x, ahead.x, seen, ahead, cancelled, fast, slip)

    def acting(self, view: View, asked: Asked, z: SimpleNamespace, c: Array, model: Model) -> tuple[Array, Array]:
        """Of the command that acts now y'' as it is to be expected, d^ included, and what is kept out of the data.

        Without an observer nobody expects anything, and what was asked is given back.
        """
        if view.seen is None:
            return asked
        meant, removed = _meant(view, asked, model), asked[1]
        if self.under_way is not None:
            meant, removed = map(self.under_way.acting, (z.under_way.accelerations, z.under_way.removed))
        return view.E @ meant + _drift(view.now, c, model), removed

    def update(
        self,
        view: View,
        expected: Array,
        asked: Asked | None,
        z: SimpleNamespace,
        k: SimpleNamespace,
        model: Model,
        step: Array,
    ) -> dict[str, Array]:
        """The states one sample later; `expected` y'' of the command that acts now, `asked` of the one given now."""
        following = dict[str, Array]()
        if self.observer is not None and view.seen is not None:
            following |= prefixed(
                "observer", self.observer.update(view.seen, expected, _drift(view.now, k.c, model), model.arrays)
            )
        if self.cancelling is not None:
            moved = self.cancelling.update(view.cancelled, z.cancelling, k.cancelling, model.arrays, step)
            following |= prefixed("cancelling", moved)
        if self.under_way is not None and asked is not None:
            pushed = self.under_way.update(_meant(view, asked, model), asked[1], z.under_way, model.arrays)
            following |= prefixed("under_way", pushed)
        if self.slip is not None and view.slip is not None:
            following |= prefixed("slip", self.slip.update(view.slip, model))
        return following


def _meant(view: View, asked: Asked, model: Model) -> Array:
    """v' (n-m,) that a command is to bring about, d^ included."""
    return asked[0] if view.seen is None else asked[0] + solve(view.E, view.seen.unexpected, model.arrays)


def _drift(x: Array, c: Array, model: Model) -> Array:
    """E' v (n-m,): y'' at v' = 0."""
    return model.output_map_rate(x, c) @ x[model.coordinate_count :]
