"""Co-simulation of a scene: a session advanced by communication steps, and the table of its variables.

======================================  ===============================================================================
variables, input_table, output_table    all variables of a scene; a row for each kind of input, for each output
variable, signals                       a variable, its unit, JSON; how outputs follow from the fields of an instant
following_outputs                       outputs that follow from others: rates, filters, largest so far
reduced_signals, load_strains           the same of an assembly marched by its modes; what its loads strain
runtime                                 in C: functions of the FMI (fmi2.c, fmi3.c), when they may be called (calls.c),
                                        steps and why they are refused (run.c), variables (variables.c), saved states
                                        (states.c), files of an FMU (image.c), results (results.c)
c_runtime, engine, handed_run           its sources; the runtime as the engine of a session; the image it takes
communication, table_file               image and table of variables as files; both are in a compiled FMU
product_tables                          tables of an image that follow from others, which its file leaves out
image_maker, started_run                the image of an FMU with Python, made for the values at the start
session, settings, scene_engine         a session, its choices and reports, the engine of its scene
parameters                              parameters that may change between steps
loads, drives, segments                 what is set from outside; histories from it; a run segment by segment
record, step_history                    what is kept of the accepted steps
waveform_relaxation                     a master that iterates a step of coupled instances
======================================  ===============================================================================

The names below are imported when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .session import Session
    from .settings import Settings, StepReport
    from .waveform_relaxation import WaveformMaster

__all__ = ["Session", "Settings", "StepReport", "WaveformMaster"]


def __getattr__(name: str) -> object:
    from importlib import import_module

    homes = {
        "Session": "session",
        "Settings": "settings",
        "StepReport": "settings",
        "WaveformMaster": "waveform_relaxation",
    }
    if name not in homes:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{homes[name]}", __name__), name)
