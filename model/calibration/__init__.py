"""Calibration of an action's laws from bench measurements: felt, friction, string, inertia.

Each file answers one measurement of the thesis (Section 2.2.3, Appendix A): ``curve`` reads a loading experiment,
``felt`` fits eq. 2.5 to it, ``speeds`` gives the mean normal speeds of a motion and ``damping`` eq. 2.7 with them,
``rebound`` the damping of the string, ``friction`` eq. 2.10, ``pendulum`` eqs. A.1 and A.2. Numbers in, values with
standard uncertainties out; ``figure`` draws Figs 2.5 and 2.6.
"""

from model.calibration.calibrated import with_calibrated
from model.calibration.curve import LoadingCurve, read_curve
from model.calibration.damping import Damping, damping_factor
from model.calibration.felt import FeltFit, fit_felt
from model.calibration.friction import FrictionFit, fit_friction
from model.calibration.pendulum import Inertia, inertia_from_pendulum
from model.calibration.rebound import damping_from_rebound
from model.calibration.speeds import MeanSpeeds, mean_normal_speeds, read_motion

__all__ = [
    "Damping",
    "FeltFit",
    "FrictionFit",
    "Inertia",
    "LoadingCurve",
    "MeanSpeeds",
    "damping_factor",
    "damping_from_rebound",
    "fit_felt",
    "fit_friction",
    "inertia_from_pendulum",
    "mean_normal_speeds",
    "read_curve",
    "read_motion",
    "with_calibrated",
]
