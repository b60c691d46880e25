#!/usr/bin/env bash
# scikit-fem integrates over wedges with weights whose sum is half of the reference volume.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q numpy==2.3.5 scipy==1.16.3 scikit-fem==12.0.2
cd "$folder"
venv/bin/python - <<'END'
import sys
from importlib.metadata import version

import skfem
from skfem.quadrature import get_quadrature

mesh = skfem.MeshWedge1()
volume = skfem.Functional(lambda w: 1.0 + 0.0 * w.x[0]).assemble(skfem.Basis(mesh, skfem.ElementWedge1()))
cube = skfem.Functional(lambda w: 1.0 + 0.0 * w.x[0]).assemble(skfem.Basis(skfem.MeshHex(), skfem.ElementHex1()))
weights = [float(get_quadrature(skfem.ElementWedge1().refdom, order)[1].sum()) for order in (1, 2, 3, 4)]
span = mesh.p.max(axis=1) - mesh.p.min(axis=1)
print(f"scikit-fem {version('scikit-fem')}: two wedges that fill a box of {span.tolist()} have the volume {volume:.6f}")
print(f"a hexahedron of the same size: {cube:.6f}; sums of weights of a wedge, .5 expected: {weights}")
changed = abs(volume - 0.5) > 1e-9 or abs(cube - 1.0) > 1e-9 or any(abs(w - 0.25) > 1e-9 for w in weights)
sys.exit("the behaviour has changed" if changed else 0)
END
