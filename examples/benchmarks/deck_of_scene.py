"""A scene of 21,000 unknowns with four bolts as a deck: brought back, and its statics run by CalculiX.

    python examples/benchmarks/deck_of_scene.py [FOLDER]

The scene is the Brake-Reuss beam of models/bolted_beam with four bolts in the place of three, held at one end: bolts
are tightened to 12 kN, 50 N bend the beam, a pulse hits its end. Printed are the largest differences of the
forces of interfaces and bolts between the scene and the one that the deck becomes, over the largest force of each, and
the forces of the bolts and the displacement of the end under the weight by both codes.
Needs gmsh and ccx (four minutes).
"""

from __future__ import annotations

import importlib
import re
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from calculix import MISSING, installed
from calculix import run as run_calculix

import latin_fmu
from latin_fmu.decks.card_text import card
from latin_fmu.decks.exporting import ExportedDeck, export_deck
from latin_fmu.decks.importing import import_deck

ROOT = Path(__file__).resolve().parents[2]
PLACES = (-45.0, -15.0, 15.0, 45.0)  # mm, of the bolts along the beam
LAP, PULL, WEIGHT = 75.0, 12e3, 50.0  # mm, half of the joint; N
TOLERANCE = {"tolerance": 1e-7}


def four_bolts(folder: Path) -> latin_fmu.Scene:
    """The scene, on a mesh that is written to a folder."""
    sys.path.insert(0, str(ROOT / "models" / "bolted_beam"))
    beam: Any = importlib.import_module("bolted_beam")
    beam.PLACES, beam.LAP = PLACES, LAP
    beam.main(folder / "four.msh", beam.Beam(layers=(1, 1), along=12, rest=2))
    parts = ["lower", "upper", *(f"bolt{i}" for i in range(1, 5))]
    data = {
        "name": "four_bolts",
        "material": {"steel": {"young_modulus": 200e9, "poisson_ratio": 0.29, "density": 7800.0}},
        "mesh": {"beam": {"file": "four.msh", "scale": 1e-3, "parts": "*", "material": "steel"}},
        "substructure": {part: {"bending_modes": True} for part in parts},
        "interface": {"lap": {"sides": ["lower.lower_lap", "upper.upper_lap"], "friction_coefficient": 0.3}},
        "contact": {"washers": {"search": 0.05e-3, "behaviour": "perfect", "except": [["lower", "upper"]]}},
        "bolt": {f"b{i}": {"substructure": f"bolt{i}", "axis": [0.0, 0.0, 1.0], "force": PULL} for i in range(1, 5)},
        "boundary": {"wall": {"type": "fixed", "face": "lower.lower_end"}},
        "load": {
            "weight": {"face": "upper.upper_end", "force": [0.0, 0.0, -WEIGHT]},
            "hammer": {"face": "upper.upper_end", "pressure": 5e6, "law": {"type": "half_sine", "duration": 0.4e-3}},
        },
        "sensor": {"tip": {"substructure": "upper", "point": [0.36, 0.0127, 0.0]}},
        "time": {"end": 0.2e-3, "step": 10e-6, "start": {"type": "static", "increments": 2}},
        "solver": TOLERANCE,
        "accuracy": {"estimate": False},
    }
    return latin_fmu.scene_from_dict(data, folder)


def brought_back(deck: ExportedDeck, folder: Path) -> latin_fmu.Scene:
    """The scene that the deck becomes, solved as accurately."""
    (folder / "four.inp").write_text(deck.text)
    tables = import_deck(folder / "four.inp", folder, "m").tables
    return latin_fmu.scene_from_dict({**tables, "solver": TOLERANCE}, folder)


def apart(here: np.ndarray, there: np.ndarray) -> float:
    """Largest difference over the largest value; the sides of an interface may be exchanged."""
    return float(min(np.abs(here - there).max(), np.abs(here + there).max()) / np.abs(here).max())


def statics(deck: ExportedDeck, folder: Path) -> tuple[dict[str, float], np.ndarray]:
    """Forces of the bolts and displacement of the end under the weight by CalculiX.

    A node of a section prints a force that is that of the bolt times a constant of its mesh
    (``findings/calculix_pretension_reaction.sh``): the force while it is tightened gives the constant.
    """
    first, second, _ = deck.steps.split("*END STEP\n", 2)
    prints = "".join("\n".join(card("NODE PRINT", {"NSET": name}, [("RF",)])) + "\n" for name in deck.bolts)
    text = f"{deck.model}{first}{prints}*END STEP\n{second}*END STEP\n"
    (folder / "statics.inp").write_text(text)
    found = run_calculix(text, 2.0, 900.0).text
    forces = {}
    for name in deck.bolts:
        rows = re.findall(rf"forces .* for set {name.upper()} and time\s+(\S+)\s+\d+\s+(\S+)", found)
        by_time = {float(time): float(force) for time, force in rows}
        forces[name] = PULL * by_time[2.0] / by_time[1.0]
    ways = re.findall(r"displacements .* for set TIP and time\s+\S+\s+\d+\s+(\S+)\s+(\S+)\s+(\S+)", found)
    return forces, np.array(ways[-1], dtype=float)


def main(folder: Path) -> int:
    """Print the differences."""
    scene = four_bolts(folder)
    deck = export_deck(scene)
    print("\n".join(line for line in deck.summary() if line.startswith("left out")))
    print(f"{3 * sum(len(rows) for rows in deck.nodes.values())} unknowns, {len(deck.bolts)} bolts")
    here, there = latin_fmu.solve(scene), latin_fmu.solve(brought_back(deck, folder))
    for name, history in here.interfaces.items():
        print(f"  {name}: forces differ by {apart(history.force(), there.interfaces[name].force()):.1e}")
    for name, bolt in here.bolts.items():
        print(f"  bolt {name}: forces differ by {apart(bolt.force, there.bolts[name].force):.1e}")
    if not installed():
        print(MISSING)
        return 0
    forces, way = statics(deck, folder)
    for name, force in forces.items():
        own = float(here.bolts[name].force[0])
        print(f"  bolt {name}: {own:.1f} N, CalculiX {force:.1f} N, {100 * abs(own / force - 1):.3f} % apart")
    own_way = here.sensors["tip"].displacement[0]
    share = 100 * np.abs(own_way - way).max() / np.abs(way).max()
    print(f"  end: {1e3 * own_way[2]:.5f} mm, CalculiX {1e3 * way[2]:.5f} mm, {share:.2f} % apart")
    return 0


if __name__ == "__main__":
    with TemporaryDirectory() as place:
        sys.exit(main(Path(sys.argv[1]) if sys.argv[1:] else Path(place)))
