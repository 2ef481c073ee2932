"""The uncertainties that an experiment may name, in the order in which they act."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager

from wmr_afl.model.model import Model
from wmr_afl.numerics.parts import prefixed
from wmr_afl.numerics.rules import Rule, Rules
from wmr_afl.plant.command_limits import CommandLimitsTable
from wmr_afl.plant.disturbance import DisturbanceTable
from wmr_afl.plant.friction import FrictionTable
from wmr_afl.plant.input_delay import InputDelayTable
from wmr_afl.plant.input_limits import InputLimitsTable
from wmr_afl.plant.lateral_slip import LateralSlipTable
from wmr_afl.plant.measurement_noise import MeasurementNoiseTable
from wmr_afl.plant.payload_change import PayloadTable
from wmr_afl.plant.uncertainty import Surroundings, Uncertainty, UncertaintyTable
from wmr_afl.plant.wheel_slip import WheelSlipTable
from wmr_input.fields import Table

At = Callable[[str], AbstractContextManager[None]]  # errors inside are mistakes at this place of the file


class UncertaintiesTable(Table):
    """What the controller does not know of, in the order in which it acts; a new uncertainty is one file and one line.

    Each key is the name of the uncertainty that its table builds.
    """

    measurement_noise: MeasurementNoiseTable | None = None
    command_limits: CommandLimitsTable | None = None
    input_delay: InputDelayTable | None = None
    input_limits: InputLimitsTable | None = None
    friction: FrictionTable | None = None
    disturbance: DisturbanceTable | None = None
    lateral_slip: LateralSlipTable | None = None
    wheel_slip: WheelSlipTable | None = None
    payload: PayloadTable | None = None

    def tables(self) -> Iterator[tuple[str, UncertaintyTable]]:
        """The tables that are given, by name."""
        return ((name, table) for name, table in vars(self).items() if table is not None)

    def build(self, surroundings: Surroundings, at: At) -> list[Uncertainty]:
        """The uncertainties that the tables describe.

        Raises:
            InputError: if one does not fit the robot, with its place.
        """
        built = []
        for name, table in self.tables():
            with at(f"[uncertainties.{name}] {table.key}".rstrip()):
                built.append(table.build(surroundings))
        return built

    def rules(self, model: Model) -> Rules:
        """What follows from other numbers of the loop, by `uncertainty.number`."""
        rules: dict[str, Rule] = {}
        for name, table in self.tables():
            rules |= prefixed(name, table.rules(model))
        return rules
