"""Experiments as TOML: a robot, a reference, controllers and what disturbs them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from wmr_afl.controllers.reference import ReferenceTable
from wmr_afl.controllers.tables import ControllerTable
from wmr_afl.errors import InputError, UnknownNameError
from wmr_afl.experiments.distributions import CampaignTable
from wmr_afl.model.files import is_path
from wmr_afl.plant.order import UncertaintiesTable
from wmr_input import read_toml
from wmr_input.csv_file import read_columns
from wmr_input.errors import FieldError
from wmr_input.fields import Number, Positive, Table

MOST_SAMPLES = 5_000_000  # of one run; 25 signals of doubles then take 1 GB of memory
_SHIPPED = Path(__file__).parent / "catalogue"  # the folder of the shipped experiments


class SimulationTable(Table):
    """Duration [s], sample time [s] and integrator."""

    duration: Positive
    sample_time: Positive
    integrator: Literal["euler", "rk4"] = "euler"

    @model_validator(mode="after")
    def _samples(self) -> SimulationTable:
        if self.sample_time > self.duration:
            raise FieldError("sample_time exceeds duration", "choose a shorter sample or a longer run")
        if self.duration / self.sample_time > MOST_SAMPLES:
            count = self.duration / self.sample_time
            raise FieldError(f"{count:.3g} samples are too many", f"stay within {MOST_SAMPLES}")
        return self


class Experiment(Table):
    """One robot, one reference, any number of controllers; `shared` holds for those that do not say otherwise."""

    instead: ClassVar[str] = (
        "name an experiment; from a file that identify has written copy robot, [parameters] and guess into one"
    )
    title: str
    source: str = ""
    robot: str
    parameters: dict[str, Number] = Field(default_factory=dict)
    start: dict[str, Number] = Field(default_factory=dict)
    reference: ReferenceTable
    simulation: SimulationTable
    uncertainties: UncertaintiesTable = UncertaintiesTable()
    campaign: CampaignTable | None = None
    shared: ControllerTable = ControllerTable()
    controllers: Annotated[dict[str, ControllerTable], Field(min_length=1)]

    @model_validator(mode="after")
    def _names_of_controllers(self) -> Experiment:
        """Check the names of controllers, which become names of files and of lines in plots."""
        seen: dict[str, str] = {}
        for name in self.controllers:
            if not name.strip() or len(name) > 60 or not name.isprintable():
                raise FieldError(f"controller {name[:60]!r} is no good name", "use one to 60 printable characters")
            other = seen.setdefault(file_name(name).lower(), name)
            if other != name:
                raise FieldError(f"controllers {other!r} and {name!r} would share files", "rename one of them")
        return self

    def place(self, controller: str, key: str) -> str:
        """Where a key of a controller stands in the file: in its own table or under [shared]."""
        own = key in self.controllers[controller].model_fields_set or key not in self.shared.model_fields_set
        return f"[controllers.{controller}] {key}" if own else f"[shared] {key}"

    def controller(self, name: str) -> ControllerTable:
        """A controller's table, completed by what stands under [shared]."""
        table = self.controllers[name]
        return self.shared.model_copy(update={key: getattr(table, key) for key in table.model_fields_set})


def file_name(name: str) -> str:
    """A controller's name as part of a file name."""
    return "".join(letter if letter.isalnum() or letter in "-_" else "_" for letter in name)


def list_experiments() -> list[str]:
    """The names of the shipped experiments."""
    return sorted(path.stem for path in _SHIPPED.glob("*.toml"))


def find_experiment(name: str | Path) -> Path:
    """The file of a shipped experiment by its name, or a file by its path.

    A path has a separator or ends in .toml, so that no file in the working directory stands in for a shipped one.

    Raises:
        UnknownNameError: if there is no such experiment.
        InputError: if there is no such .toml file.
    """
    path, is_toml = Path(name), Path(name).suffix == ".toml"
    if (is_path(name) or is_toml) and os.path.isfile(path):  # unlike Path.is_file, no error if the name is too long
        return path
    if str(name) in list_experiments():
        return _SHIPPED / f"{name}.toml"
    if is_toml:
        raise InputError(str(path), "", "no such file", "check the path")
    here = [place for place in (f"./{name}", f"{name}.toml") if os.path.isfile(place)]
    hint = f"write {here[0]} for the file here" if here else ""
    raise UnknownNameError("experiment", str(name), list_experiments(), hint)


def read_experiment(name: str | Path) -> tuple[Experiment, Path]:
    """A shipped experiment by name, or one by its file, and the path of the file.

    Raises:
        InputError: if the file has a mistake.
        UnknownNameError: if there is no such experiment.
    """
    path = find_experiment(name)
    return with_points(read_toml(path, Experiment), path), path


def with_points(experiment: Experiment, path: Path) -> Experiment:
    """The experiment in `path` with the points of its reference in it, read from their files if they stand in some.

    Raises:
        InputError: if the file cannot be read, or is no table of numbers.
    """
    reference = experiment.reference.with_points(lambda file: read_columns(path.parent / file))
    return experiment if reference is experiment.reference else experiment.model_copy(update={"reference": reference})
