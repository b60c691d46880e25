#!/usr/bin/env bash
# CalculiX 2.20 doubles the internal energy of a *DYNAMIC step that follows a *STATIC one under the same load: nothing
# moves, displacements and stresses stay, and ELSE is twice that of the static step, which is half of force times way.
# Takes Debian's package (apt-get install calculix-ccx=2.20-1, Debian 12).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
version=$( (ccx -v || true) | grep -o "[0-9]*\.[0-9]*" || true)
echo "CalculiX $version"
[ "$version" = 2.20 ] || { echo "the version is another one" >&2; exit 1; }

cat > pulled.inp <<'DECK'
*NODE,NSET=ALL
1,0.,0.,0.
2,10.,0.,0.
3,10.,10.,0.
4,0.,10.,0.
5,0.,0.,30.
6,10.,0.,30.
7,10.,10.,30.
8,0.,10.,30.
*NSET,NSET=TOP
5,6,7,8
*ELEMENT,TYPE=C3D8,ELSET=BAR
1,1,2,3,4,5,6,7,8
*MATERIAL,NAME=STEEL
*ELASTIC
210000.,0.
*DENSITY
7.8e-9
*SOLID SECTION,ELSET=BAR,MATERIAL=STEEL
*BOUNDARY
1,1,3
2,1,3
3,1,3
4,1,3
*STEP
*STATIC
1.,1.
*CLOAD
TOP,3,2500.
*NODE PRINT,NSET=TOP
U
*EL PRINT,ELSET=BAR,TOTALS=ONLY
ELSE
*END STEP
*STEP
*DYNAMIC,DIRECT
1.e-6,2.e-6
*NODE PRINT,NSET=TOP
U
*EL PRINT,ELSET=BAR,TOTALS=ONLY
ELSE
*END STEP
DECK
timeout 60 ccx pulled > log || true
ways=$(awk '/displacements/ {inside = 1; next} inside && $1 == 5 {print $4; inside = 0}' pulled.dat)
energies=$(awk '/total internal energy/ {getline; getline; print $1}' pulled.dat)
echo "way of the top, mm:" $ways
echo "ELSE, mJ:" $energies "(half of 10 kN times the way: $(echo "$ways" | awk 'NR == 1 {printf "%.6g", 5000 * $1}'))"
echo "$ways $energies" | tr '\n' ' ' | awk '{n = NF / 2; still = 1; for (i = 2; i <= n; i++) if (($i / $1 - 1)^2 > 1e-6) still = 0;
    exit !(still && $NF / $(n + 1) > 1.99 && $NF / $(n + 1) < 2.01)}'
