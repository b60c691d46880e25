"""What tools may take from inside the solver, beside the public names of the package (``latin_fmu.__all__``).

Tools are studies, estimates, pictures, commands and the builder of FMUs. A change of the solver keeps the names that
stand here, or changes their tools with them; ``tests/test_architecture.py`` refuses any other, and one that no
tool takes. Co-simulation and Model Exchange run the engine itself and are no tools.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

ROOMS: Final = (
    "cholesky",
    "laws",
    "kernels",
    "fem",
    "interface",
    "time_scheme",
    "propagator",
    "latin",
    "assembly",
    "joined",
    "statics",
    "checks",
    "building",
    "march",
    "sensitivities",
    "attempts",
    "compiled",
    "modal",
    "effects",
    "run_quantities",
)
"""Folders and modules of the solver."""
TOOLS: Final = ("accuracy", "stability", "parametric", "calibration", "pictures", "commands", "cli", "fmu_build")
"""Folders and modules that are tools."""
NAMES: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "assembly.body": ("Body", "build_bodies", "elasticity_of", "fast_elasticity_of"),
        "assembly.interfaces": ("completed", "with_found"),
        "assembly.models": ("KeptOperators",),
        "assembly.problem": ("DiscretisedProblem",),
        "assembly.propagator_choice": ("factor_bytes",),
        "attempts": ("StandingRun", "standing_again"),
        "building": ("discretise",),
        "checks.mesh_checks": ("check_faces",),
        "compiled": ("CONSTANTS", "PLAIN", "compiled_run", "hosted_run", "libraries", "library"),
        "compiled.library": ("suffix", "target"),
        "effects.cost": ("Prediction", "amount", "memory_need"),
        "effects.explanation": ("WORTH", "Explanation", "explain"),
        "effects.scene_effects": ("scene_with",),
        "fem.elements": ("rigid_modes",),
        "fem.mesh": ("Array", "FacetSet", "Index", "Mesh", "boundary", "box_mesh", "cell_blocks", "nearest"),
        "fem.reference_cells": ("CELL_EDGES", "HEX_FACES"),
        "interface.laws": ("SEPARATION", "SLIP"),
        "latin.assembly": ("Array", "InterfaceUnit"),
        "latin.interface_rows": ("InterfaceRows",),
        "latin.outcome": (
            "Array",
            "BoltHistory",
            "InterfaceHistory",
            "Outcome",
            "SensorHistory",
            "SubstructureHistory",
            "Timings",
        ),
        "latin.processes": ("Processes",),
        "latin.settings": ("accuracy_of", "tolerance_for"),
        "latin.state_serialization": ("decode", "encode", "opened", "sealed"),
        "modal.backbone": ("Backbone", "backbone"),
        "modal.frequency_response": ("FrequencyResponse", "frf"),
        "modal.modes": ("vibration_modes",),
        "modal.random_response": ("LinearResponse", "LinearSignal", "random_response"),
        "run_quantities": (
            "ELEMENTS_PER_WAVE",
            "Quantities",
            "measure_solution",
            "of_force",
            "relative",
            "resolved_frequency",
        ),
        "sensitivities.tangents": ("value_of",),
    }
)
"""Names by module."""
