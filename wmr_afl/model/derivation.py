"""The public function that derives a robot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from wmr_afl.model.packages import derivation
from wmr_afl.numerics.arguments import checked, to_write


@checked
def derive(description: str | Path, out: str | Path | None = None) -> Any:
    """Derive the robot that a TOML file describes; needs the extra `derive`.

    `out`: a folder into which the robot's model is also written, as `out`/<name of the robot>/. The derivation that is
    returned holds SymPy matrices, such as `kinematics.kinematic_matrix` S (3) and `dynamics.inertia_matrix` Mbar (14).

    Raises:
        InputError: if the description is wrong.
        WmrError: if SymPy is not installed or `out` cannot be written.
    """
    path = Path(description)
    derived = derivation("derivation").derive_robot(path)
    if out is not None:
        write = derivation("codegen.write")
        files = write.files_of(derived, path)
        write.write({f"{derived.robot.name}/{name}": text for name, text in files.items()}, to_write("out", out))
    return derived
