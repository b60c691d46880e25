#!/bin/sh
# Virtual environments of the FMI hosts of tests/fmu/test_hosts.py, below the folder given. Debian or Ubuntu, x86-64.
#   sh tests/fmu/install_hosts.sh ~/fmi-hosts
#   LATIN_FMU_HOSTS=~/fmi-hosts python -m pytest -m slow tests/fmu/test_hosts.py
set -eu
folder=${1:?usage: install_hosts.sh FOLDER}
needed="numpy scipy numba scikit-fem meshio pydantic xarray netCDF4 threadpoolctl"
make_host() { # name of the environment, packages of the host
    python3 -m venv "$folder/$1"
    "$folder/$1/bin/pip" install -q $2 $needed
}
make_host libcosimpy "libcosimpy"
make_host ecospy "ecospy"
make_host pathsim "pathsim-fmi fmpy"
make_host toolbox "fmu-manipulation-toolbox"
if ! ldconfig -p | grep -q 'libtbb.so.12'; then # ecospy is linked against it
    if [ "$(id -u)" = 0 ]; then apt-get install -y -q libtbb12; else sudo apt-get install -y -q libtbb12; fi
fi
