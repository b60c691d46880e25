"""LATIN method for shocks on assemblies with frictional contact.

After P. Ladeveze, H. Lemoussu, P.A. Boucard, "A modular approach to 3-D impact computation with frictional contact",
Computers and Structures 78 (2000) 45-51; equation numbers below and in all docstrings are the paper's.

Unknown: velocity W and traction F on both sides of every interface, over a window of time. F is what the interface
exerts on a side; N points from side E to side E'. Two groups of equations, satisfied in turn:

=====================================================================  ==========================================
equations                                                              module
=====================================================================  ==========================================
(1)-(5)    kinematics, initial values, equilibrium, elasticity         fem.elements, assembly.conditions
(6), (15)  an interface behaviour and its contract                     interface.laws
(7)        perfect connection                                          laws.perfect
(8)-(14)   linear stage: F - F_hat = -k (W - W_hat), dashpots k        kernels.substructure, kernels.linear_stage
           in windows of several instants                              kernels.iteration, kernels.instants
(12)-(17)  search directions k                                         latin.search_direction
(15)-(17)  local stage: F_hat - F = k (W_hat - W), point by point      kernels.local_stage, laws.dispatch
(18)-(19)  points, normals, gap of an interface                        assembly.interfaces
(20)-(23)  unilateral contact; Coulomb friction: stick and slip        laws.contact, laws.parts
(24)       error indicator; force residual                             kernels.indicator
           loop, relaxation, acceleration; from instant to instant     kernels.iteration, kernels.acceleration
                                                                       kernels.instants
           Newton steps where the iteration is slow                    kernels.newton, kernels.envelope, kernels.krylov
           windows, fall-backs                                         latin.windows, latin.solver
           t = 0                                                       latin.initial_conditions
           time schemes; their energy identity                         time_scheme.implicit, kernels.energy
=====================================================================  ==========================================

Faces whose nodes do not match are joined by ``fem.mortar``. What a run holds in numbers lies in a few pools of memory
that ``kernels.records`` describes.

A run: ``solve(load_scene("scene.toml"))`` gives a ``Solution`` whose ``to_datatree()`` and ``save()`` give xarray
and netCDF.
"""

from __future__ import annotations

from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from .accuracy.estimate import estimate_error
    from .api import check, solve
    from .calibration.study import calibrate
    from .errors import InputError, LatinError, MeshError, ResultsError, SceneError, SolverError
    from .march import Iteration
    from .modal.backbone import backbone
    from .modal.frequency_response import frf
    from .modal.modes import vibration_modes
    from .parametric.random_vibration import random_vibration
    from .parametric.samples import sample
    from .parametric.study import sweep
    from .reader import load_scene, scene_from_dict
    from .results.checkpoint import Checkpoint
    from .results.files import open_results
    from .results.solution import Solution
    from .results.spectra import shock_response_spectrum
    from .results.views import amplitude_spectrum, pressure_map, resultant, ring_down, sensor_spectrum, skin
    from .scene.schema import Scene
    from .shock.base_histories import base_history
    from .shock.random_motion import AccelerationDensity, RandomMotion
    from .shock.specification import Specification

__version__ = "0.3.0"

__all__ = [
    "AccelerationDensity",
    "Checkpoint",
    "InputError",
    "Iteration",
    "LatinError",
    "MeshError",
    "RandomMotion",
    "ResultsError",
    "Scene",
    "SceneError",
    "Solution",
    "SolverError",
    "Specification",
    "amplitude_spectrum",
    "backbone",
    "base_history",
    "calibrate",
    "check",
    "estimate_error",
    "frf",
    "load_scene",
    "open_results",
    "pressure_map",
    "random_vibration",
    "resultant",
    "ring_down",
    "sample",
    "scene_from_dict",
    "sensor_spectrum",
    "shock_response_spectrum",
    "skin",
    "solve",
    "sweep",
    "vibration_modes",
]

# Where the names come from: imported when they are first used, so that a command or an FMU loads what it needs.
_MODULES: Final = MappingProxyType(
    {
        **dict.fromkeys(
            ("InputError", "LatinError", "MeshError", "ResultsError", "SceneError", "SolverError"), "errors"
        ),
        "Checkpoint": "results.checkpoint",
        "Iteration": "march",
        "Scene": "scene.schema",
        "Solution": "results.solution",
        "backbone": "modal.backbone",
        "calibrate": "calibration.study",
        "check": "api",
        "estimate_error": "accuracy.estimate",
        "frf": "modal.frequency_response",
        "load_scene": "reader",
        "open_results": "results.files",
        "random_vibration": "parametric.random_vibration",
        "sample": "parametric.samples",
        "scene_from_dict": "reader",
        "shock_response_spectrum": "results.spectra",
        **dict.fromkeys(("AccelerationDensity", "RandomMotion"), "shock.random_motion"),
        "base_history": "shock.base_histories",
        "Specification": "shock.specification",
        "solve": "api",
        "sweep": "parametric.study",
        "vibration_modes": "modal.modes",
        **dict.fromkeys(
            ("amplitude_spectrum", "pressure_map", "resultant", "ring_down", "sensor_spectrum", "skin"), "results.views"
        ),
    }
)


def __getattr__(name: str) -> Any:
    module = _MODULES.get(name)
    if module is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f".{module}", __name__), name)
    return value


def __dir__() -> list[str]:
    return ["__version__", *__all__]
