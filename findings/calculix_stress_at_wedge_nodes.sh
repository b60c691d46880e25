#!/usr/bin/env bash
# CalculiX 2.20 carries the stresses of C3D6 from its two integration points to the nodes (*EL FILE) with the factors
# 1.1455 and -0.1455, those of points at 0.7746 of the half height; the points, whose stresses *EL PRINT prints, are at
# 0.5774: a stress that grows linearly along a wedge is 1.366 times its first value less 0.366 times its second one at
# the first face. At the node of the wedge below the stress is 7 % too small.
# Takes Debian's package (apt-get install calculix-ccx=2.20-1, Debian 12).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
version=$( (ccx -v || true) | grep -o "[0-9]*\.[0-9]*" || true)
echo "CalculiX $version"
[ "$version" = 2.20 ] || { echo "the version is another one" >&2; exit 1; }
cat > wedge.inp <<'DECK'
*NODE
1,0.,0.,0.
2,10.,0.,0.
3,0.,10.,0.
4,0.,0.,20.
5,10.,0.,20.
6,0.,10.,20.
*ELEMENT,TYPE=C3D6,ELSET=ALL
1,1,2,3,4,5,6
*MATERIAL,NAME=STEEL
*ELASTIC
210000.,0.3
*SOLID SECTION,ELSET=ALL,MATERIAL=STEEL
*BOUNDARY
1,1,3
2,1,3
3,1,3
*STEP
*STATIC
*CLOAD
4,1,10.
4,3,10.
*EL PRINT,ELSET=ALL
S
*EL FILE
S
*END STEP
DECK
timeout 60 ccx wedge > log
# szz at both points, and at node 1
read -r first second <<< "$(awk '$1 == 1 && NF == 8 {printf "%s ", $5}' wedge.dat)"
node=$(awk '/ -4  STRESS/ {on = 1} on && substr($0, 1, 13) == " -1         1" {print substr($0, 38, 12); exit}' wedge.frd)
echo "szz at the points $first, $second; at node 1 $node"
echo "$first $second $node" | awk '{
    right = 1.3660254 * $1 - 0.3660254 * $2; theirs = 1.1454972 * $1 - 0.1454972 * $2
    printf "on the line through the points: %g; with their factors: %g\n", right, theirs
    exit !((($3 - theirs) / theirs)^2 < 1e-6 && (($3 - right) / right)^2 > 1e-3)
}'
