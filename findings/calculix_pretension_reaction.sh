#!/usr/bin/env bash
# CalculiX 2.20 prints as the force (RF) on the node of a *PRE-TENSION SECTION the force of the bolt divided by a number
# that depends on the mesh of the section: a bar whose section is pulled by 1000 N is held by 1000 N at its end, and RF
# of the node is 250.0 with one element across the section, 64.7 with 2 x 2; so it stays when the node is fixed later.
# Takes Debian's package (apt-get install calculix-ccx=2.20-1, Debian 12).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
version=$( (ccx -v || true) | grep -o "[0-9]*\.[0-9]*" || true)
echo "CalculiX $version"
[ "$version" = 2.20 ] || { echo "the version is another one" >&2; exit 1; }

# bar COUNT: a deck of a bar of 10 x 10 x 40 mm with COUNT x COUNT x 4 elements, cut in its middle, held at both ends
bar() {
    awk -v n="$1" 'function node(i, j, k) {return 1 + i + (n + 1) * (j + (n + 1) * k)}
    BEGIN {
        print "*NODE"
        for (k = 0; k <= 4; k++) for (j = 0; j <= n; j++) for (i = 0; i <= n; i++)
            printf "%d,%.9g,%.9g,%.9g\n", node(i, j, k), 10 * i / n, 10 * j / n, 10 * k
        print "*NODE,NSET=PULLED\n9999,0.,0.,0.\n*ELEMENT,TYPE=C3D8,ELSET=BAR"
        for (k = 0; k < 4; k++) for (j = 0; j < n; j++) for (i = 0; i < n; i++) {
            printf "%d,%d,%d,%d,%d,%d,%d,%d,%d\n", ++e, node(i, j, k), node(i + 1, j, k), node(i + 1, j + 1, k),
                node(i, j + 1, k), node(i, j, k + 1), node(i + 1, j, k + 1), node(i + 1, j + 1, k + 1), node(i, j + 1, k + 1)
            if (k == 1) cut = cut e ",S2\n"
        }
        printf "*SURFACE,NAME=CUT,TYPE=ELEMENT\n%s*NSET,NSET=LOW,GENERATE\n1,%d\n", cut, (n + 1) ^ 2
        printf "*NSET,NSET=HIGH,GENERATE\n%d,%d\n", node(0, 0, 4), node(n, n, 4)
        print "*PRE-TENSION SECTION,SURFACE=CUT,NODE=9999\n0.,0.,1."
        print "*MATERIAL,NAME=STEEL\n*ELASTIC\n210000.,0.3\n*SOLID SECTION,ELSET=BAR,MATERIAL=STEEL"
        print "*BOUNDARY\nLOW,1,3\nHIGH,1,3\n*STEP\n*STATIC\n1.,1.\n*CLOAD\n9999,1,1000."
        print "*NODE PRINT,NSET=PULLED\nRF\n*NODE PRINT,NSET=LOW,TOTALS=ONLY\nRF\n*END STEP"
        print "*STEP\n*STATIC\n1.,1.\n*BOUNDARY,FIXED\n9999,1,1\n*END STEP"
    }' > bar.inp
    timeout 60 ccx bar > log || true
    awk '/total force/ {getline; getline; held = $3} $1 == 9999 {rf = rf " " $2} END {print rf, held}' bar.dat
}
for count in 1 2; do
    read -r first second held <<< "$(bar "$count")"
    echo "$count x $count elements: RF of the node $first, then fixed $second; force on the end $held"
    echo "$count $first $second $held" | awk '{exit !(($4 + 1000)^2 < 1 && $2 < 0.5 * 1000 && ($2 / $3 - 1)^2 < 1e-6)}'
done
