"""Experiments ready to run, assembled again only if their files have changed."""

from __future__ import annotations

import functools
import hashlib
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from wmr_afl.errors import UnknownNameError, WmrError
from wmr_afl.experiments.assembly import assemble, model_of
from wmr_afl.experiments.experiment import Experiment, find_experiment, with_points
from wmr_afl.simulation.closed_loop import ClosedLoop
from wmr_input import read_toml
from wmr_input.errors import mistakes_at, shown


@dataclass(frozen=True, eq=False)
class Loaded:
    """An experiment, the file where it stands, and the closed loop of each of its controllers."""

    experiment: Experiment
    path: Path
    loops: dict[str, ClosedLoop]

    def name(self, controller: str | None = None) -> str:
        """A controller's name, checked; the first one's if none is given.

        Raises:
            UnknownNameError: if there is no such controller.
        """
        name = next(iter(self.loops)) if controller is None else controller
        if not (isinstance(name, str) and name in self.loops):
            raise UnknownNameError("controller", name if isinstance(name, str) else shown(name), self.loops)
        return name

    def drawn(self, controllers: Iterable[str] | str | None = None) -> list[str]:
        """The controllers of a campaign: those that are given, or else those of [campaign], or else the first one.

        Raises:
            InputError: if the file names one that is not there, or one twice.
            UnknownNameError: if there is no such controller.
            WmrError: if none is given.
        """
        if controllers is not None:
            given = [controllers] if isinstance(controllers, str) else controllers
            names = list(dict.fromkeys(str(self.name(name)) for name in given))
            if not names:
                raise WmrError("no controller is named", f"name one or more of {', '.join(self.loops)}")
            return names
        table = self.experiment.campaign
        named = None if table is None else table.controller
        with mistakes_at(self.path, "[campaign] controller"):
            names = [self.name(name) for name in (named if isinstance(named, list) else [named])]
            if len(set(names)) < len(names):
                raise WmrError(f"names one twice: {', '.join(names)}", "name each once")
        return names


def load_experiment(name: str | Path) -> Loaded:
    """A shipped experiment by name, or one by its file.

    Raises:
        InputError: if the file has a mistake.
        UnknownNameError: if there is no such experiment.
    """
    path = find_experiment(name)
    place, text = path.absolute(), _digest([path])
    experiment = _read(path, place, text)
    complete = with_points(experiment, path)
    points = "" if complete is experiment else repr(complete.reference)
    return _assembled(path, place, text, points, _stamps(model_of(experiment, path)))


@functools.lru_cache(maxsize=16)
def _read(path: Path, place: Path, text: str) -> Experiment:
    return read_toml(path, Experiment)


@functools.lru_cache(maxsize=16)
def _assembled(path: Path, place: Path, text: str, points: str, model: tuple[tuple[int, int, int], ...]) -> Loaded:
    experiment = with_points(_read(path, place, text), path)
    return Loaded(experiment, path, assemble(experiment, path))


def _stamps(folder: Path) -> tuple[tuple[int, int, int], ...]:
    """Inode, time and size of each file of a model; enough, because files are replaced, never written into."""
    found = (os.stat(folder / name) for name in sorted(os.listdir(folder)))
    return tuple((file.st_ino, file.st_mtime_ns, file.st_size) for file in found)


def _digest(files: Iterable[Path]) -> str:
    """The digest of the content of files. A file that cannot be read is skipped: reading it reports the error."""
    content = hashlib.sha256()
    for file in files:
        try:
            content.update(file.read_bytes())
        except OSError:
            continue
    return content.hexdigest()
