"""Adaptive feedback linearizing control of wheeled mobile robots: models, controllers, simulation.

import wmr_afl
model = wmr_afl.load_model("type_2_0")
result = wmr_afl.run("study_1")
result["AFL"].rms(since=100.0)
"""

from wmr_afl.batch import BatchResult, run_batch
from wmr_afl.campaigns import CampaignResult, campaign, replay
from wmr_afl.errors import (
    BackendWarning,
    CompilerError,
    InputError,
    MissingTermError,
    ShapeError,
    SimulationError,
    UnknownNameError,
    WmrError,
)
from wmr_afl.experiment import list_experiments
from wmr_afl.model import Model, load_model
from wmr_afl.model_files import list_models
from wmr_afl.realtime import Controller
from wmr_afl.run import Failure, Run
from wmr_afl.running import run
from wmr_afl.simulation import SimulationWarning

__all__ = [
    "BackendWarning",
    "BatchResult",
    "CampaignResult",
    "CompilerError",
    "Controller",
    "Failure",
    "InputError",
    "MissingTermError",
    "Model",
    "Run",
    "ShapeError",
    "SimulationError",
    "SimulationWarning",
    "UnknownNameError",
    "WmrError",
    "campaign",
    "list_experiments",
    "list_models",
    "load_model",
    "replay",
    "run",
    "run_batch",
]
