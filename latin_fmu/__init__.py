"""LATIN method for shocks on assemblies with frictional contact."""

from .api import check, solve
from .errors import InputError, LatinError, MeshError, ResultsError, SceneError, SolverError
from .observe import Iteration
from .results.netcdf import open_results
from .results.solution import Solution
from .scene.reader import load_scene, scene_from_dict
from .scene.schema import Scene

__version__ = "0.1.0"

__all__ = [
    "InputError", "Iteration", "LatinError", "MeshError", "ResultsError", "Scene", "SceneError", "Solution",
    "SolverError", "check", "load_scene", "open_results", "scene_from_dict", "solve",
]  # fmt: skip
