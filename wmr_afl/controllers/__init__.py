"""Control laws: one law a file, each reading like its equation, none knowing a robot."""

from wmr_afl.controllers.adaptation import GradientAdaptation
from wmr_afl.controllers.leakage import Leakage
from wmr_afl.controllers.linearizing_law import LinearizingLaw
from wmr_afl.controllers.modification import Modification
from wmr_afl.controllers.normalization import Normalization
from wmr_afl.controllers.outer_loop import OuterLoop
from wmr_afl.controllers.projection import Projection
from wmr_afl.controllers.robust_term import RobustTerm
from wmr_afl.controllers.tracking_law import Knowledge, TrackingLaw

__all__ = [
    "GradientAdaptation",
    "Knowledge",
    "Leakage",
    "LinearizingLaw",
    "Modification",
    "Normalization",
    "OuterLoop",
    "Projection",
    "RobustTerm",
    "TrackingLaw",
]
