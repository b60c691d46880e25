"""Seven screws of a public CAD assembly, from its STEP file to their tension; needs gmsh and, once, the network.

AS1 is a test assembly of the exchange of CAD data: two angle brackets on a plate, held by six screws with nuts whose
shanks fill their holes, and a rod with two nuts. Its file is fetched; ``latin-fmu mesh`` meshes its 18 parts, finds the
screws and writes the scene. A file that is there already is not fetched.

    python examples/as1_screws.py [FOLDER]

It writes as1.stp, as1.msh and as1.toml in the folder (the current one), and prints the tension of each screw beside its
target.
"""

from __future__ import annotations

import subprocess
import sys
import urllib.request
from pathlib import Path

import latin_fmu

SOURCE = "https://raw.githubusercontent.com/tpaviot/pythonocc-demos/master/assets/models/as1-oc-214.stp"


def main(folder: Path) -> None:
    """Fetch, mesh, tighten."""
    folder.mkdir(parents=True, exist_ok=True)
    step, name = folder / "as1.stp", folder / "as1"
    if not step.exists():
        urllib.request.urlretrieve(SOURCE, step)
    subprocess.run([sys.executable, "-m", "latin_fmu", "mesh", str(step), "-o", str(name)], check=True)
    scene = latin_fmu.load_scene(folder / "as1.toml")
    solution = latin_fmu.solve(scene)
    for bolt, result in solution.bolts.items():
        target = scene.bolt[bolt].tension(1.0)
        assert target is not None
        print(f"{bolt}: {result.force[-1]:.6g} N, off by {abs(result.force[-1] / target - 1.0):.1e}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
