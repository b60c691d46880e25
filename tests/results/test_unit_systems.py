"""The key ``units``: equal scenes in several systems give equal results, each with the names of its own units.

What a name is worth is taken from the names themselves (a millimetre is 1e-3 m, a pound-force 4.448 N), not from the
sizes that the package keeps.
"""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
import pytest

import latin_fmu
from fmu_build.build import fmu_files
from latin_fmu.errors import SceneError
from latin_fmu.modal.modes import vibration_modes
from latin_fmu.parametric.point import Grid, Parameter, Plan, PointSolver
from latin_fmu.parametric.study import dataset_of
from latin_fmu.results.files import open_results
from latin_fmu.results.views import pressure_map, resultant
from latin_fmu.scene.units import SI, UNIT_SYSTEMS

WORTH = {"mm": 1e-3, "t": 1e3, "MPa": 1e6, "mJ": 1e-3, "mW": 1e-3, "in": 0.0254, "lbf": 4.4482216152605}
WORTH |= {"psi": WORTH["lbf"] / WORTH["in"] ** 2, "m": 1.0, "kg": 1.0, "s": 1.0, "N": 1.0, "Pa": 1.0, "J": 1.0}
WORTH |= {"W": 1.0, "Hz": 1.0, "1": 1.0, "B": 1.0}
SYSTEMS = {"SI": (1.0, 1.0), "mm-t-s-MPa": (1e-3, 1.0), "in-lbf-s-psi": (0.0254, 4.4482216152605)}  # m, N


def worth(unit: str) -> float:
    """Size in SI of a UDUNITS string, by the names in it."""
    total = 1.0
    for factor in unit.split():
        name = factor.rstrip("-.0123456789") or "1"
        total *= WORTH[name] ** float(factor[len(name) :] or 1.0)
    return total


def tables(system: str, folder: Path) -> dict[str, Any]:
    """Two cubes of 10 mm, the upper one thrown at the lower, pressed by a history in a file in MPa."""
    metre, newton = SYSTEMS[system]
    second = 1.0
    pascal, kilogram = newton / metre**2, newton * second**2 / metre
    (folder / "press.csv").write_text("0,100\n2e-5,0\n")

    def cube(z: float) -> dict[str, Any]:
        box = {"origin": [0.0, 0.0, z / metre], "size": [0.01 / metre] * 3, "elements": [2, 2, 2]}
        return {"material": "steel", "box": box}

    steel = {"young_modulus": 210e9 / pascal, "poisson_ratio": 0.3, "density": 7800.0 / (kilogram / metre**3)}
    law = {"type": "csv", "file": "press.csv", "value_unit": "MPa"}
    return {
        "name": "cubes",
        "units": system,
        "material": {"steel": steel},
        "substructure": {
            "lower": cube(0.0),
            "upper": cube(0.01001) | {"initial_velocity": [0.5 / metre, 0.0, -4.0 / metre]},
        },
        "interface": {"crush": {"sides": ["lower.zmax", "upper.zmin"], "friction_coefficient": 0.2}},
        "boundary": {"hold": {"type": "fixed", "face": "lower.zmin"}},
        "load": {"press": {"face": "upper.zmax", "pressure": 1.0, "law": law}},
        "sensor": {"tip": {"face": "upper.zmax", "spectrum": {"lowest": 2e4, "highest": 2e5, "per_octave": 2}}},
        "output": dict.fromkeys(("fields", "stress", "energy", "surfaces", "reactions"), True),
        "solver": {"tolerance": 1e-6},
        "time": {"end": 2e-5, "instants": 60, "scheme": "generalized_alpha"},
    }


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> dict[str, latin_fmu.Solution]:
    folder = tmp_path_factory.mktemp("units")
    return {s: latin_fmu.solve(latin_fmu.scene_from_dict(tables(s, folder), folder)) for s in SYSTEMS}


@pytest.mark.parametrize("system", ["mm-t-s-MPa", "in-lbf-s-psi"])
def test_results_are_those_in_si(solved: dict[str, latin_fmu.Solution], system: str) -> None:
    """Every number of the results times the worth of its unit; the tolerance of the iteration is 1e-6."""
    si, other = solved["SI"].to_datatree(), solved[system].to_datatree()
    named = set()
    for node in si.subtree:
        for name, variable in node.to_dataset().variables.items():
            if "units" not in variable.attrs or node.path == "/convergence" or name in ("balance", "error_indicator"):
                continue
            unit = other[node.path][name].attrs["units"]
            named.add(unit)
            expected = np.asarray(variable.values, dtype=float)
            values = np.asarray(other[node.path][name].values, dtype=float) * worth(unit)
            scale = np.abs(expected[np.isfinite(expected)]).max(initial=0.0)
            terms = node.to_dataset().data_vars.values() if node.path.endswith("energy") else ()
            scale = max([scale, *(float(np.abs(term.values).max()) for term in terms)])
            assert np.allclose(values, expected, rtol=1e-3, atol=1e-4 * scale, equal_nan=True), f"{node.path}/{name}"
    assert other.attrs["unit_system"] == system
    assert named >= ({"mm", "N", "MPa", "mJ", "mm s-1", "mm2"} if system[0] == "m" else {"in", "lbf", "psi", "lbf in"})


def test_texts_and_figures(solved: dict[str, latin_fmu.Solution]) -> None:
    solution = solved["mm-t-s-MPa"]
    text = solution.summary(details=True)
    assert " mm  " in text
    assert " mJ" in text
    assert " mm/s" in text
    assert not [word for word in (" um", "kPa", " km", " mmm") if word in text]
    assert solution.report()["units"] == "mm-t-s-MPa"
    tree = solution.to_datatree()
    assert pressure_map(tree, "crush")["pressure"].attrs["units"] == "MPa"
    assert resultant(tree, "crush")["normal"].attrs["units"] == "N"


def test_a_file_a_study_and_modes(solved: dict[str, latin_fmu.Solution], tmp_path: Path) -> None:
    solved["mm-t-s-MPa"].save(tmp_path / "out.nc")
    with open_results(tmp_path / "out.nc") as tree:
        assert tree["interfaces/crush/gap"].attrs["units"] == "mm"
    data = tables("mm-t-s-MPa", tmp_path)
    grid = Grid(data, tmp_path, (Parameter("load.press.pressure", (1.0, 2.0)),))
    record = PointSolver(Plan(grid, histories=False)).solve((0,))
    study = dataset_of(grid, grid.scene(), {(0,): record}, histories=False)
    assert study["energy"].attrs["units"] == "mJ"
    assert study["load_press_pressure"].attrs["units"] == "MPa"
    modes = vibration_modes(latin_fmu.scene_from_dict(data, tmp_path), "sticking", 1)
    assert modes.groups()["/modes"].variables["modal_mass"].attrs["units"] == "t"
    assert any(" t " in line for line in modes.lines())


def test_checks_in_the_units_of_the_scene(tmp_path: Path) -> None:
    """Consistent numbers give no remark on units; the same numbers called SI do, with the key that mends it."""
    for system in SYSTEMS:
        scene = latin_fmu.scene_from_dict(tables(system, tmp_path), tmp_path)
        codes = {remark.code for remark in latin_fmu.api.checked(scene)[1]}
        assert not codes & {"material", "size", "load", "gap"}, (system, codes)
    wrong = tables("mm-t-s-MPa", tmp_path) | {"units": "SI"}
    lines, remarks, _ = latin_fmu.api.checked(latin_fmu.scene_from_dict(wrong, tmp_path))
    assert any('units = "mm-t-s-MPa"' in remark for remark in remarks)
    in_pascal = tables("mm-t-s-MPa", tmp_path)
    in_pascal["material"]["steel"]["young_modulus"] = 210e9
    in_pascal["material"]["other"] = dict(in_pascal["material"]["steel"], young_modulus=7e4, density=2.7e-9)
    in_pascal["substructure"]["lower"]["material"] = "other"
    remarks = latin_fmu.api.checked(latin_fmu.scene_from_dict(in_pascal, tmp_path))[1]
    assert any("if it is in Pa, write 210000 (MPa)" in remark for remark in remarks), remarks
    assert lines[1].endswith("27 nodes, 8 hexahedron")
    assert " mm, " in latin_fmu.check(latin_fmu.scene_from_dict(in_pascal, tmp_path))[1]


def test_units_of_files_need_the_reader(tmp_path: Path) -> None:
    """A scene built without the reader does not know the folder of files nor its units when these are read."""
    with pytest.raises(SceneError, match="units of files are not converted here"):
        latin_fmu.Scene.model_validate(tables("mm-t-s-MPa", tmp_path), context={"base_dir": tmp_path})


def test_an_unknown_system_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="units"):
        latin_fmu.scene_from_dict(tables("SI", tmp_path) | {"units": "mm"}, tmp_path)


def test_an_initial_state_in_other_units_is_refused(solved: dict[str, latin_fmu.Solution], tmp_path: Path) -> None:
    solved["mm-t-s-MPa"].save(tmp_path / "out.nc")
    data = tables("SI", tmp_path) | {"initial_state": {"file": "out.nc", "time": 0.0}}
    del data["substructure"]["upper"]["initial_velocity"]
    with pytest.raises(SceneError, match="in other units than the scene"):
        latin_fmu.scene_from_dict(data, tmp_path)


def test_a_system_is_one_object_in_all_processes() -> None:
    for system in UNIT_SYSTEMS.values():
        assert pickle.loads(pickle.dumps(system)) is system
    assert SI["kg m-3"] == "kg/m3"


def test_descriptions_of_fmus(tmp_path: Path) -> None:
    """Units of a description have their names and their size in SI, by which hosts convert."""
    from xml.etree.ElementTree import fromstring

    units: dict[str, dict[str, Element]] = {}
    for system in SYSTEMS:
        scene = latin_fmu.scene_from_dict(tables(system, tmp_path), tmp_path)
        root = fromstring(fmu_files(scene, "3")["modelDescription.xml"])
        units[system] = {str(u.get("name")): u[0] for u in root.iterfind("UnitDefinitions/Unit")}
        named = {element.get("unit") for element in root.iterfind("ModelVariables/*")} - {None}
        assert named <= set(units[system])
    assert all("factor" not in base.attrib for base in units["SI"].values())
    millimetre = units["mm-t-s-MPa"]["mm"]
    assert (millimetre.get("m"), float(millimetre.get("factor", "1"))) == ("1", 1e-3)
    newton = units["mm-t-s-MPa"]["N"]
    assert float(newton.get("factor", "1")) == 1.0
    inch = units["in-lbf-s-psi"]["in/s"]
    assert float(inch.get("factor", "1")) == pytest.approx(0.0254)
