"""The order of frames in their tree: parents before children."""

from wmr_input import closest

from . import tables as toml
from .reader import Reader


def parents_first(frames: list[toml.Frame], reader: Reader) -> list[toml.Frame]:
    """The frames in an order in which every parent stands before its children.

    Raises:
        InputError: If there is not one root, a parent is unknown, or frames form a loop.
    """
    roots = [frame for frame in frames if frame.parent is None]
    if len(roots) != 1:
        found = ", ".join(repr(frame.name) for frame in roots) or "none"
        raise reader.mistake("[[frames]]", f"there must be one root frame, found {found}", "give the others a parent")
    names = [frame.name for frame in frames]
    for frame in frames:
        if frame.parent is not None and frame.parent not in names:
            remedy = closest(frame.parent, names)
            raise reader.mistake(f"[[frames]] {frame.name!r} parent", f"unknown frame {frame.parent!r}", remedy)
    ordered = roots
    while len(ordered) < len(frames):
        placed = {frame.name for frame in ordered}
        ready = [frame for frame in frames if frame.name not in placed and frame.parent in placed]
        if not ready:
            loop = _loop([frame for frame in frames if frame.name not in placed])
            problem = "the frames form a loop, " + " -> ".join(loop)
            raise reader.mistake(f"[[frames]] {loop[0]!r} parent", problem, "hang one of them on the root's side")
        ordered = ordered + ready
    return ordered


def _loop(frames: list[toml.Frame]) -> list[str]:
    """A loop among frames each of which has its parent among them."""
    parent_of = {frame.name: str(frame.parent) for frame in frames}
    chain = [frames[0].name]
    while parent_of[chain[-1]] not in chain:
        chain.append(parent_of[chain[-1]])
    return [*chain[chain.index(parent_of[chain[-1]]) :], parent_of[chain[-1]]]
