#!/usr/bin/env bash
# CalculiX 2.20 stabilises C3D8R against hourglass modes with vectors from which the linear part along z alone is taken:
# those along x and y stay, so that distorted elements resist uniform strain and rotations. The element below, one
# corner of a cube moved, is turned by a small rigid rotation u = w x x, all nodes prescribed: C3D8 needs no forces,
# C3D8R up to 0.0013 of E times the edge times the angle. On parallelepipeds, where all three parts are zero, there is no
# error.
# Takes Debian's package (apt-get install calculix-ccx=2.20-1, Debian 12).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
version=$( (ccx -v || true) | grep -o "[0-9]*\.[0-9]*" || true)
echo "CalculiX $version"
[ "$version" = 2.20 ] || { echo "the version is another one" >&2; exit 1; }
nodes="0 0 0
1 0 0
1.4 1.3 0
0 1 0
0 0 1
1 0 1
1 1 1
0 1 1"
# largest reaction of the element of type $1 under the rotation about axis $2 (z or x) by 1e-3
reaction() {
    {
        echo "*NODE"
        awk '{printf "%d,%g,%g,%g\n", NR, $1, $2, $3}' <<< "$nodes"
        # a second body with free nodes: a deck without unknowns is none
        awk '{printf "%d,%g,%g,%g\n", NR + 10, $1 + 9, $2, $3}' <<< "$nodes"
        printf '*ELEMENT,TYPE=%s,ELSET=A\n1,1,2,3,4,5,6,7,8\n*ELEMENT,TYPE=C3D8,ELSET=B\n2,11,12,13,14,15,16,17,18\n' "$1"
        printf '*NSET,NSET=N,GENERATE\n1,8\n*MATERIAL,NAME=M\n*ELASTIC\n1.,0.3\n'
        printf '*SOLID SECTION,ELSET=A,MATERIAL=M\n*SOLID SECTION,ELSET=B,MATERIAL=M\n*STEP\n*STATIC\n*BOUNDARY\n'
        printf '11,1,3\n12,1,3\n14,1,3\n'
        if [ "$2" = z ]; then
            awk '{printf "%d,1,1,%g\n%d,2,2,%g\n%d,3,3\n", NR, -1e-3 * $2, NR, 1e-3 * $1, NR}' <<< "$nodes"
        else
            awk '{printf "%d,1,1\n%d,2,2,%g\n%d,3,3,%g\n", NR, NR, -1e-3 * $3, NR, 1e-3 * $2}' <<< "$nodes"
        fi
        printf '*NODE PRINT,NSET=N\nRF\n*END STEP\n'
    } > turn.inp
    timeout 60 ccx turn > log
    awk '$1 ~ /^[1-8]$/ && NF == 4 {for (i = 2; i <= 4; i++) if ($i * $i > m) m = $i * $i} END {printf "%.3e", sqrt(m)}' turn.dat
}
full=$(reaction C3D8 z)
one=$(reaction C3D8R z)
other=$(reaction C3D8R x)
echo "largest reaction of a rigid rotation of 1e-3, E = 1: C3D8 $full; C3D8R $one about z, $other about x"
awk -v full="$full" -v one="$one" 'BEGIN {exit !(full < 1e-12 && one > 1e-7)}'
