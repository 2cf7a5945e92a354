"""Fits of physics and appearance to observations: refine a rough estimate to about one per cent."""

from simtune.fit.calibration.bootstrap import FEW_EPISODES, MANY_EPISODES, run_bootstrap
from simtune.fit.calibration.model_checks import (
    Unexplained,
    elsewhere_warning,
    has_comparison,
    held_out_misfit,
    is_misshapen,
    is_motion_unexplained,
    lacks_known_worlds,
    model_checks,
    what_is_unexplained,
)
from simtune.fit.calibration.refits import Refits
from simtune.fit.calibration.uncertainty import calibrated, correlated_pairs
from simtune.fit.fit_warnings import (
    bound_warnings,
    delay_warnings,
    timestep_warning,
)
from simtune.fit.lateness import PICTURES, READINGS, Lateness, states_in_late_pictures
from simtune.fit.motion.estimator import StateEstimator
from simtune.fit.observed import Observed, Split
from simtune.fit.physics import Physics
from simtune.fit.pictures.response import Photometry
from simtune.fit.readings.descent import Descent
from simtune.fit.readings.joint_motion import JointMotion, left_open
from simtune.fit.readings.loop_setup import set_up_loop, where_starts_show
from simtune.fit.readings.open_loop import OpenLoopReplay
from simtune.fit.readings.output_error import OutputErrorMethod, ReplayStage
from simtune.fit.readings.output_error_fit import OutputErrorFit
from simtune.fit.readings.readings import Readings
from simtune.fit.readings.recorded_loop import recorded_loop
from simtune.fit.readings.replay_objective import Guess
from simtune.fit.readings.segments import FEWEST_STEPS
from simtune.fit.readings.whole_episodes import replay_whole
from simtune.fit.replay_fit import ReplayFit
from simtune.fit.result import FitResult, PointEstimate
from simtune.fit.sizing import FitConfig, FitWork, count_fit_steps

__all__ = [
    "FEWEST_STEPS",
    "FEW_EPISODES",
    "MANY_EPISODES",
    "PICTURES",
    "READINGS",
    "Descent",
    "FitConfig",
    "FitResult",
    "FitWork",
    "Guess",
    "JointMotion",
    "Lateness",
    "Observed",
    "OpenLoopReplay",
    "OutputErrorFit",
    "OutputErrorMethod",
    "Photometry",
    "Physics",
    "PointEstimate",
    "Readings",
    "Refits",
    "ReplayFit",
    "ReplayStage",
    "Split",
    "StateEstimator",
    "Unexplained",
    "bound_warnings",
    "calibrated",
    "correlated_pairs",
    "count_fit_steps",
    "delay_warnings",
    "elsewhere_warning",
    "has_comparison",
    "held_out_misfit",
    "is_misshapen",
    "is_motion_unexplained",
    "lacks_known_worlds",
    "left_open",
    "model_checks",
    "recorded_loop",
    "replay_whole",
    "run_bootstrap",
    "set_up_loop",
    "states_in_late_pictures",
    "timestep_warning",
    "what_is_unexplained",
    "where_starts_show",
]
