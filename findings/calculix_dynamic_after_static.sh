#!/usr/bin/env bash
# CalculiX 2.20 stops at a *DYNAMIC step that follows a *STATIC one unless an energy is among the outputs of the first
# step; the same motion as the only step runs, and so does the pair with a total of the internal energy printed.
# Takes Debian's package (apt-get install calculix-ccx=2.20-1, Debian 12).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
version=$( (ccx -v || true) | grep -o "[0-9]*\.[0-9]*" || true)
echo "CalculiX $version"
[ "$version" = 2.20 ] || { echo "the version is another one" >&2; exit 1; }

block() {
    cat <<'DECK'
*NODE,NSET=ALL
1,0.,0.,0.
2,10.,0.,0.
3,10.,10.,0.
4,0.,10.,0.
5,0.,0.,10.
6,10.,0.,10.
7,10.,10.,10.
8,0.,10.,10.
*NSET,NSET=TOP
5,6,7,8
*ELEMENT,TYPE=C3D8,ELSET=BLOCK
1,1,2,3,4,5,6,7,8
*MATERIAL,NAME=STEEL
*ELASTIC
210000.,.3
*DENSITY
7.8e-9
*SOLID SECTION,ELSET=BLOCK,MATERIAL=STEEL
*BOUNDARY
1,1,3
2,1,3
3,1,3
4,1,3
DECK
}

static() {
    printf '*STEP\n*STATIC\n1.,1.\n*CLOAD\nTOP,3,10.\n%b*END STEP\n' "$1"
}

dynamic() {
    printf '*STEP\n*DYNAMIC,DIRECT\n1.e-6,1.e-5\n%b*NODE PRINT,NSET=TOP\nU\n*END STEP\n' "$1"
}

solve() {
    code=0
    timeout 60 ccx "$1" > "$1.log" || code=$?
    lines=$(grep -c "displacements" "$1.dat" || true)
    echo "$1: exit $code, displacements at $lines instants, $(grep -A1 "ERROR" "$1.log" | tr -s ' \n' ' ' || true)"
}

{ block; static ''; dynamic ''; } > pair.inp
{ block; static '*EL PRINT,ELSET=BLOCK,TOTALS=ONLY\nELSE\n'; dynamic ''; } > pair_with_energy.inp
{ block; dynamic '*CLOAD\nTOP,3,10.\n'; } > motion_alone.inp
for deck in pair pair_with_energy motion_alone; do solve "$deck"; done
grep -q "energy output must be selected in the first step" pair.log
[ "$(grep -c displacements pair.dat || true)" = 0 ]
[ "$(grep -c displacements pair_with_energy.dat)" = 10 ]
[ "$(grep -c displacements motion_alone.dat)" = 10 ]
