"""Control laws: one law a file, each reading like its equation, none knowing a robot."""

from wmr_afl.controllers.adaptation import GradientAdaptation
from wmr_afl.controllers.direct_adaptation import DirectAdaptation
from wmr_afl.controllers.law import Knowledge, Law
from wmr_afl.controllers.leakage import Leakage
from wmr_afl.controllers.least_squares import LeastSquares
from wmr_afl.controllers.linearizing_law import LinearizingLaw
from wmr_afl.controllers.live_reference import LiveReference, ReferenceBuffer
from wmr_afl.controllers.modification import Modification
from wmr_afl.controllers.normalization import Normalization
from wmr_afl.controllers.outer_loop import OuterLoop
from wmr_afl.controllers.passivity_law import Effort, PassivityLaw
from wmr_afl.controllers.path import along
from wmr_afl.controllers.pieces import Pieces
from wmr_afl.controllers.projection import Projection
from wmr_afl.controllers.reference import Reference
from wmr_afl.controllers.robust_term import RobustTerm
from wmr_afl.controllers.sampled import Sampled
from wmr_afl.controllers.tracking_law import TrackingLaw
from wmr_afl.controllers.waypoints import Waypoints

__all__ = [
    "DirectAdaptation",
    "Effort",
    "GradientAdaptation",
    "Knowledge",
    "Law",
    "Leakage",
    "LeastSquares",
    "LinearizingLaw",
    "LiveReference",
    "Modification",
    "Normalization",
    "OuterLoop",
    "PassivityLaw",
    "Pieces",
    "Projection",
    "Reference",
    "ReferenceBuffer",
    "RobustTerm",
    "Sampled",
    "TrackingLaw",
    "Waypoints",
    "along",
]
