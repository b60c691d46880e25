"""Units of everything that a user is given, by dimensional analysis: the same scene in another system of units.

A scene is solved in kilogram, metre and second, and in units 8, 4 and 2 times smaller. A number whose unit is
kg^a m^b s^c must be 8^a 4^b 2^c times as large. The factors are powers of two: iterations are the same bit for bit.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
import pytest
import xarray as xr

import latin_fmu
from latin_fmu.accuracy.estimate import estimate_error
from latin_fmu.cosim import Session
from latin_fmu.cosim.variables import table_of
from latin_fmu.parametric.point import Grid, Parameter, Plan, PointSolver
from latin_fmu.parametric.study import dataset_of
from latin_fmu.results import views
from latin_fmu.scene.readable_numbers import readable
from latin_fmu.scene.units import unit_text
from latin_fmu.stability.scenes import half_sine

KILOGRAM, METRE, SECOND = 8.0, 4.0, 2.0
"""Size of the numbers of one kilogram, metre and second in the other system."""
BASE = {
    "kg": (1, 0, 0),
    "m": (0, 1, 0),
    "s": (0, 0, 1),
    "Hz": (0, 0, -1),
    "N": (1, 1, -2),
    "Pa": (1, -1, -2),
    "J": (1, 2, -2),
    "W": (1, 2, -3),
    "rad": (0, 0, 0),
    "1": (0, 0, 0),
}
BY_CLOCK = re.compile("cpu|memory")  # measured, not computed


def factor(unit: str) -> float:
    """Numbers of a UDUNITS unit in the other system over those in SI."""
    total = np.zeros(3)
    for part in unit.split():
        name, power = re.fullmatch(r"([A-Za-z]+|1)(-?[0-9.]+)?", part).groups()
        total += float(power or 1) * np.array(BASE[name])
    return float(KILOGRAM ** total[0] * METRE ** total[1] * SECOND ** total[2])


def tables(other: bool) -> dict[str, Any]:
    """A block thrown at two blocks joined by a layer, with everything that has results."""

    def number(value: float, unit: str) -> float:
        return value * (factor(unit) if other else 1.0)

    def block(z: float) -> dict[str, Any]:
        origin, size = ([number(x, "m") for x in xs] for xs in ([0.0, 0.0, z], [0.01] * 3))
        return {"material": "steel", "box": {"origin": origin, "size": size, "elements": [2, 2, 2]}}

    modulus, density = number(210e9, "Pa"), number(7800.0, "kg m-3")
    steel = {"young_modulus": modulus, "poisson_ratio": 0.3, "density": density}
    layer = {"normal_stiffness": number(1e14, "N m-3"), "tangential_stiffness": number(1e14, "N m-3")}
    joint = {"normal_viscosity": number(1e6, "N s m-3"), "tangential_viscosity": number(1e6, "N s m-3")}
    low_pass = {"type": "low_pass", "cutoff": number(1e5, "Hz")}
    spectrum = {"lowest": number(2e4, "Hz"), "highest": number(2e5, "Hz"), "per_octave": 3}
    return {
        "name": "units",
        "material": {"steel": steel},
        "substructure": {
            "base": block(0.0),
            "middle": block(0.01),
            "upper": block(0.02),
            "top": block(0.030001) | {"initial_velocity": [number(v, "m s-1") for v in (0.5, 0.0, -4.0)]},
        },
        "interface": {
            "glue": {"sides": ["base.zmax", "middle.zmin"], "behaviour": "elastic_layer", **layer},
            "pad": {"sides": ["middle.zmax", "upper.zmin"], "behaviour": "viscous_joint", **joint},
            "crush": {"sides": ["upper.zmax", "top.zmin"], "friction_coefficient": 0.2},
        },
        "boundary": {"hold": {"type": "fixed", "face": "base.zmin"}},
        "load": {"press": {"face": "top.zmax", "pressure": number(1e8, "Pa"), "law": half_sine(number(6e-6, "s"))}},
        "sensor": {"tip": {"face": "top.zmax", "spectrum": spectrum, "filter": low_pass}},
        "output": {
            **dict.fromkeys(("fields", "stress", "strain", "nodal_stress", "principal_stress", "surfaces"), True),
            **dict.fromkeys(("energy", "reactions"), True),
        },
        "solver": {"tolerance": 1e-4},
        "time": {"end": number(16e-6, "s"), "instants": 80},
    }


@cache
def solved(other: bool) -> latin_fmu.Solution:
    return latin_fmu.solve(latin_fmu.scene_from_dict(tables(other)))


@cache
def tree(other: bool) -> xr.DataTree:
    return solved(other).to_datatree()


def compare(si: xr.Dataset, other: xr.Dataset, where: str) -> Iterator[str]:
    """Variables whose numbers do not change as their unit requires, or that have numbers without a unit."""
    for name, variable in si.variables.items():
        values, changed = np.asarray(variable.values), np.asarray(other[name].values)
        if values.dtype.kind != "f" or BY_CLOCK.search(str(name)):
            continue
        if "units" not in variable.attrs:
            yield f"{where}/{name} has no unit"
            continue
        expected = values * factor(variable.attrs["units"])
        scale = np.abs(expected[np.isfinite(expected)]).max(initial=0.0)
        if name == "balance":  # round-off of the other terms
            scale = max(float(np.abs(term.values).max()) for term in other.data_vars.values())
        if not np.allclose(changed, expected, rtol=1e-9, atol=1e-9 * scale, equal_nan=True):
            yield f"{where}/{name} is not in {variable.attrs['units']}"


def test_results() -> None:
    assert solved(False).converged
    si, other = tree(False), tree(True)
    wrong = [
        text for node in si.subtree for text in compare(node.to_dataset(), other[node.path].to_dataset(), node.path)
    ]
    assert wrong == []
    assert {f"/interfaces/{n}" for n in ("glue", "pad", "crush")} <= {node.path for node in si.subtree}
    for name in ("friction_power", "gap", "slip", "pressure"):
        assert np.abs(si[f"interfaces/crush/{name}"].values).max() > 0.0, name
    durations = [t["interfaces/crush/peak_force"].attrs["peak_duration"] for t in (si, other)]
    assert durations[1] == pytest.approx(SECOND * durations[0], rel=1e-9)


def test_views() -> None:
    made = {
        "resultant": lambda t, _: views.resultant(t, "crush"),
        "pressure_map": lambda t, _: views.pressure_map(t, "crush"),
        "skin": lambda t, _: views.skin(t, "top"),
        "sensor_spectrum": lambda t, f: views.sensor_spectrum(t, "tip", f),
        "amplitude_spectrum": lambda t, _: views.amplitude_spectrum(t, "tip").to_dataset(name="amplitude"),
    }
    hertz = np.array([3e4, 1e5])
    for name, view in made.items():
        pair = view(tree(False), hertz), view(tree(True), hertz * factor("Hz"))
        assert list(compare(*pair, name)) == []


def test_error_estimates() -> None:
    """Value and unit travel together, in the table too."""
    si, other = (estimate_error(latin_fmu.scene_from_dict(tables(b)), solved(b)) for b in (False, True))
    for one, two in zip(si.quantities, other.quantities, strict=True):
        assert two.value == pytest.approx(one.value * factor(one.unit), rel=1e-9), one.quantity
        assert f" {readable(one.value, one.unit)}" in next(t for t in si.lines() if t.startswith(one.quantity + " "))
    row = next(text for text in si.lines() if text.startswith("crush.force_rms"))
    assert re.search(r" [0-9.]+ [mk]?N ", row), row


def test_variables_of_a_session() -> None:
    """Outputs of an FMU after a few steps; counts and shares have unit 1."""
    rows = []
    for other in (False, True):
        scene = latin_fmu.scene_from_dict(tables(other))
        session, h = Session(scene), 1e-6 * (SECOND if other else 1.0)
        session.initialize()
        for i in range(8):
            assert session.step(i * h, h)
        rows.append(session.row.copy())
    units = {v.name: v.unit for v in table_of(scene) if v.name in session.outputs}
    assert set(session.outputs) == set(units)
    for name, one, two in zip(session.outputs, *rows, strict=True):
        size = factor(units[name] or "1")  # whole numbers have no unit in FMI
        assert two == pytest.approx(one * size, rel=1e-7, abs=1e-9 * abs(size)), name


def test_studies() -> None:
    """Dataset of a sweep of one point; histories, too."""
    made = []
    for other in (False, True):
        pressure = Parameter("load.press.pressure", (tables(other)["load"]["press"]["pressure"],))
        grid = Grid(tables(other), ".", (Parameter("interface.crush.friction_coefficient", (0.2,)), pressure))
        record = PointSolver(Plan(grid, histories=True)).solve((0, 0))
        made.append(dataset_of(grid, grid.scene(), {(0, 0): record}, histories=True))
        assert record["state"] == 0, record["message"]
    assert list(compare(*made, "study")) == []
    assert {"energy", "peak_reaction", "acceleration_peak_unfiltered", "force", "force_rms"} <= set(made[0])


@pytest.mark.parametrize(
    ("value", "unit", "text", "figure"),
    [
        (1.458e-3, "N s", "1.458 mN s", None),
        (60.40, "N s", "60.40 N s", None),
        (2.5e-6, "m2", "2.5e-06 m2", "2.5e-06 m²"),
        (1.5e-3, "m s-1", "1.500 mm/s", None),
        (2.5e-6, "s", "2.500 us", "2.500 µs"),
        (31250.0, "m s-2", "3.125e+04 m/s2", "3.125e+04 m/s²"),
        (3.9, "kg", "3.900 kg", None),
        (3.9e-3, "kg", "3.900 g", None),
        (1118034.0, "1", "1.118e+06", None),
        (0.0, "N", "0 N", None),
    ],
)
def test_text_of_a_number(value: float, unit: str, text: str, figure: str | None) -> None:
    assert readable(value, unit) == text
    assert readable(value, unit, figure=True) == (figure or text)


def test_text_of_a_unit() -> None:
    assert [unit_text(u) for u in ("s-1", "N m-3", "N s", "1")] == ["1/s", "N/m3", "N s", ""]
