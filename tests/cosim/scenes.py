"""Small scenes for co-simulation tests: a second or less each."""

from __future__ import annotations

from typing import Any

import numpy as np

import latin_fmu
from latin_fmu.assembly.segments import Segment
from latin_fmu.cosim import Session
from latin_fmu.cosim.kernel_steps import Origin
from latin_fmu.cosim.loads import GridPart, Loads
from latin_fmu.cosim.windowed import Windowed
from latin_fmu.scene.schema import Scene
from latin_fmu.stability.scenes import STEEL, Box, Material, column, half_sine


def blocks(**changes: Any) -> Scene:
    """Two blocks of 2 x 2 x 2 elements pressed together with friction; load ``press`` is set from outside.

    ``changes`` replace top-level tables.
    """
    block = Box(STEEL, (0.01,) * 3, (2,) * 3)
    data = column(
        {"lower": block, "upper": block},
        {"crush": {"friction_coefficient": 0.2}},
        {"end": 6e-6, "step": 0.2e-6},
        name="blocks",
        boundary={"base": {"type": "fixed", "face": "lower.zmin"}},
        load={
            "press": {"face": "upper.zmax", "pressure": 100e6, "law": {"type": "input", "start_value": 0.25}},
            "push": {"face": "upper.xmin", "traction": [10e6, 0.0, 0.0], "law": half_sine(9e-6)},
        },
        sensor={"head": {"substructure": "upper", "point": [0.005, 0.005, 0.02]}},
        output={"energy": True},
    )
    return latin_fmu.scene_from_dict(data | changes)


def bar(**changes: Any) -> Scene:
    """A bar of five elements thrown against a wall, no load from outside."""
    data = column(
        {"bar": Box(Material(900.0, name="soft"), (1.0, 1.0, 10.0), (1, 1, 5), (0.0, 0.0, -10.0))},
        {},
        {"end": 1.0, "instants": 50},
        name="thrown_bar",
        interface={"wall": {"sides": ["bar.zmin", "ground"], "gap": 0.5}},
    )
    data["substructure"]["bar"]["box"]["origin"][2] = 0.5
    return latin_fmu.scene_from_dict(data | changes)


def by_python(session: Session) -> Session:
    """Let every step of a session in windowed mode, after its initialization, be made as a segment of a run: histories
    from the laws of the scene (``Timeline``), marched without communication steps."""
    mode = session._mode
    assert isinstance(mode, Windowed)
    kernels = mode.kernels

    def given_up(loads: Loads, part: GridPart, _early: bool) -> None:
        run = mode.run
        state = run.get_state() if run.made else {"made": 0, "state": np.zeros(0)}
        kernels.begun, kernels._ends = Origin(state, loads, part, part.n), part.n

    def recorded(_early: bool = False) -> Segment:
        step, run = kernels.begun, mode.run
        assert step is not None
        run.set_state(step.state if step.state["made"] else None)
        loads = step.loads.driving(step.part, run.dt, mode.rule)
        end, recorder = (run.made + step.n) * run.dt, mode._outputs.recorder(loads)
        with np.errstate(all="ignore"):
            return run.advance(end, step.n, loads, recorder=recorder)

    kernels.march, kernels.recorded = given_up, recorded  # type: ignore[method-assign,assignment]
    kernels.accept = lambda loads: loads.accept(kernels.begun.part, mode.run.dt, mode.rule)  # type: ignore
    return session
