"""Adaptive feedback linearizing control of wheeled mobile robots: models, controllers, simulation.

import wmr_afl
model = wmr_afl.load_model("type_2_0")
result = wmr_afl.run("study_1")
result["AFL"].rms(since=100.0)
"""

from wmr_afl.controllers.live_reference import LiveReference, ReferenceBuffer
from wmr_afl.controllers.path import along
from wmr_afl.controllers.pieces import Pieces
from wmr_afl.controllers.reference import Reference
from wmr_afl.controllers.sampled import Sampled
from wmr_afl.controllers.waypoints import Waypoints
from wmr_afl.errors import (
    ArgumentError,
    BackendWarning,
    CompilerError,
    InputError,
    MissingTermError,
    ShapeError,
    SimulationError,
    UnknownNameError,
    WmrError,
)
from wmr_afl.experiments.campaigns import CampaignResult, campaign, compare, replay
from wmr_afl.experiments.experiment import list_experiments
from wmr_afl.experiments.run import run, run_batch
from wmr_afl.identification.identified import Identified
from wmr_afl.identification.identify import identify
from wmr_afl.identification.log import Log
from wmr_afl.identification.voltage_design import excite
from wmr_afl.model.derivation import derive
from wmr_afl.model.files import list_models
from wmr_afl.model.model import Model, load_model
from wmr_afl.model.packages import generated as _generated
from wmr_afl.onboard.controller import Controller, Diagnostics
from wmr_afl.onboard.export import export
from wmr_afl.simulation.batch import BatchResult
from wmr_afl.simulation.result import Failure, Run
from wmr_afl.simulation.simulate import SimulationWarning
from wmr_afl.validation.validate import Validation, validate

generated = _generated()

__all__ = [
    "ArgumentError",
    "BackendWarning",
    "BatchResult",
    "CampaignResult",
    "CompilerError",
    "Controller",
    "Diagnostics",
    "Failure",
    "Identified",
    "InputError",
    "LiveReference",
    "Log",
    "MissingTermError",
    "Model",
    "Pieces",
    "Reference",
    "ReferenceBuffer",
    "Run",
    "Sampled",
    "ShapeError",
    "SimulationError",
    "SimulationWarning",
    "UnknownNameError",
    "Validation",
    "Waypoints",
    "WmrError",
    "along",
    "campaign",
    "compare",
    "derive",
    "excite",
    "export",
    "generated",
    "identify",
    "list_experiments",
    "list_models",
    "load_model",
    "replay",
    "run",
    "run_batch",
    "validate",
]
