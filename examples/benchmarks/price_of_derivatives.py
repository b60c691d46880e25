"""Price of the derivatives by five parameters: CPU time of a run with them over that of the same run without.

    python examples/benchmarks/price_of_derivatives.py [--repeat 5]

Crushing of two specimens (``models/two_specimen_crushing``) with 4^3 and 10^3 elements a block. The parameters of the
first row enter loads, gaps and laws, those of the second row masses and stiffnesses, too. The runs in turn, the best
of the repetitions; ratios to the run without derivatives, where no derivative is checked by a run, and where those are
that are by default (body forces that are 0 are not).
"""

from __future__ import annotations

import argparse
import time as clock
from pathlib import Path

import latin_fmu

MODEL = Path(__file__).resolve().parents[2] / "models/two_specimen_crushing/scene.toml"
LOADS = (
    "interface.crush.friction_coefficient",
    "load.press.pressure",
    "load.press.law.duration",
    "substructure.upper.body_force.0",
    "substructure.lower.body_force.2",
)
MATERIALS = (
    *LOADS[:2],
    "material.steel.young_modulus",
    "material.aluminium.density",
    "material.aluminium.young_modulus",
)


def seconds(scene: latin_fmu.Scene) -> float:
    """CPU time of a run, s."""
    start = clock.process_time()
    latin_fmu.solve(scene)
    return clock.process_time() - start


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeat", type=int, default=5)
    repeat = parser.parse_args().repeat
    print("| elements a block | parameters | run, s | nothing checked | by default |\n" + "|---" * 5 + "|")
    for n in (4, 10):
        sizes = [f"substructure.{body}.box.elements=[{n},{n},{n}]" for body in ("lower", "upper")]
        plain = latin_fmu.load_scene(MODEL, sizes)
        for name, parameters in (("loads and laws", LOADS), ("materials, too", MATERIALS)):
            checked = plain.replace("output.sensitivities", list(parameters))
            scenes = (plain, checked.replace("output.check_sensitivities", "none"), checked)
            seconds(checked)
            runs = [[seconds(scene) for scene in scenes] for _ in range(repeat)]
            own, alone, whole = map(min, zip(*runs, strict=True))
            print(f"| {n}^3 | {name} | {own:.3f} | {alone / own:.1f} | {whole / own:.1f} |")


if __name__ == "__main__":
    main()
