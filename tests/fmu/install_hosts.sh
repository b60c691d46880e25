#!/bin/sh
# FMI hosts of tests/fmu/test_hosts.py, in virtual environments below the folder given (Linux, x86-64).
#   sh tests/fmu/install_hosts.sh ~/fmi-hosts            # all
#   sh tests/fmu/install_hosts.sh ~/fmi-hosts common     # those that share one environment
#   sh tests/fmu/install_hosts.sh ~/fmi-hosts sources    # after common: OMSimulator, vdmcheck (git, cmake, ninja, JDK)
#   LATIN_FMU_HOSTS=~/fmi-hosts python -m pytest tests/fmu/test_hosts.py
# What cannot be installed is named and left out: its tests are then skipped.
set -u
folder=${1:?usage: install_hosts.sh FOLDER [common] [cofmupy] [gemseo] [sources]}
shift
[ $# -gt 0 ] || set -- common cofmupy gemseo
needed="numpy scipy meshio pydantic xarray netCDF4 threadpoolctl" # by an FMU; not latin-fmu itself
limit=$(command -v timeout > /dev/null && echo "timeout 240")

install() { # environment, packages
    env=$1
    shift
    $limit "$folder/$env/bin/pip" install -q --disable-pip-version-check "$@" || echo "not installed: $*"
}

at=${LATIN_FMU_SOURCES:-https://github.com} # or a folder of clones, OWNER/NAME
taken() { # repository, tag or commit, folder, paths
    [ -d "$3" ] || git clone -q --no-checkout "$at/$1" "$3" || return
    (cd "$3" && tag=$2 && shift 3 && git checkout -q "$tag" -- "$@")
}

omsimulator() { # OMSimulator==3.0.0: its package gets a program from elsewhere when installed, so from sources
    from=$folder/sources/OMSimulator to=$("$folder/common/bin/python" -c 'import site; print(site.getsitepackages()[0])')
    taken OpenModelica/OMSimulator v3.0.0 "$from" CMakeLists.txt config.cmake doc include schema src || return
    taken OpenModelica/OMSimulator-3rdParty f807ac3664cf21a86304e56e1b8ebf7b192f26b8 "$from/3rdParty" . || return
    echo v3.0.0 > "$from/version.txt"
    cmake -S "$from" -B "$from/b" -G Ninja -DCMAKE_BUILD_TYPE=Release > "$from/log" 2>&1 || return
    ninja -C "$from/b" OMSimulatorLib >> "$from/log" 2>&1 || return
    mkdir -p "$to/OMSimulator" "$to/OMSimulator-3.0.0.dist-info"
    cp "$from"/src/OMSimulatorPython/*.py "$to/OMSimulator"
    cp "$from"/b/src/OMSimulatorPython/*.py "$to/OMSimulator" # with the name of the library
    cp "$from/b/src/OMSimulatorLib/libOMSimulator.so" "$to/OMSimulator"
    cp -r "$from/schema" "$to/OMSimulator"
    printf 'Metadata-Version: 2.1\nName: OMSimulator\nVersion: 3.0.0\n' > "$to/OMSimulator-3.0.0.dist-info/METADATA"
}

compiled() { # sources in Java, class path
    mkdir -p "$2"
    find "$1/java" -name '*.java' > "$2.list"
    javac -nowarn -encoding UTF-8 ${3:+-cp "$3"} -d "$2" "@$2.list" 2> "$2.log" || return
    [ ! -d "$1/resources" ] || cp -r "$1/resources/." "$2"
}

vdmcheck() { # programs vdmcheck2.sh and vdmcheck3.sh, which print true for a valid FMU
    from=$folder/sources to=$folder/vdmcheck
    taken nickbattle/vdmj 4.5.0-release "$from/vdmj" vdmj annotations || return
    taken INTO-CPS-Association/FMI-VDM-Model Release/1.1.3 "$from/rules" fmi2 fmi3 fmuReader xsd2vdm || return
    mkdir -p "$to"
    compiled "$from/vdmj/vdmj/src/main" "$to/vdmj" "" || return
    compiled "$from/vdmj/annotations/src/main" "$to/annotations" "$to/vdmj" || return
    compiled "$from/rules/xsd2vdm/src/main" "$to/xsd2vdm" "" || return
    compiled "$from/rules/fmuReader/src/main" "$to/reader" "$to/vdmj:$to/xsd2vdm" || return
    for fmi in 2 3; do
        model=$from/rules/fmi$fmi/rule-model schema=$from/rules/fmi$fmi/vdmcheck/src/main/resources/fmi${fmi}schema
        cat > "$to/vdmcheck$fmi.sh" << END_OF_SCRIPT
cd "$model" && exec java -Xmx1500m -Dvdmj.parser.merge_comments=true -Dfmureader.noschema=true \\
    -Dfmureader.xsd="$schema/fmi$fmi.xsd" -Dfmureader.vdmfile= \\
    -cp "$to/vdmj:$to/annotations:$to/xsd2vdm:$to/reader" com.fujitsu.vdmj.VDMJ -vdmsl -q -annotations \\
    -e "isValidFMIConfigurations(modelDescription, buildDescription, terminalsAndIcons)" *.vdmsl Rules/*.adoc "\$1"
END_OF_SCRIPT
    done
}

for env in "$@"; do
    if [ "$env" = sources ]; then
        mkdir -p "$folder/sources"
        for tool in omsimulator vdmcheck; do
            $tool || echo "not installed: $tool"
        done
        continue
    fi
    ${PYTHON:-python3} -m venv "$folder/$env" || continue
    case $env in
        common)
            install common $needed
            for host in fmu-manipulation-toolbox==2.0 libcosimpy==0.0.6 pathsim-fmi==0.1.1 ecospy==0.7.2 fmuloader==0.1.2rc0; do
                install common $host
            done
            if ! ldconfig -p 2> /dev/null | grep -q 'libtbb.so.12'; then # ecospy is linked against it
                [ "$(id -u)" = 0 ] && root= || root="sudo -n"
                $limit $root apt-get install -y -q libtbb12 > /dev/null 2>&1 || echo "not installed: libtbb12 of Debian, for ecospy"
            fi ;;
        cofmupy) install cofmupy cofmupy==1.0.0 $needed ;;
        gemseo) install gemseo gemseo-fmu==3.1.1 $needed ;;
        *) echo "no environment of this name: $env" ;;
    esac
done
