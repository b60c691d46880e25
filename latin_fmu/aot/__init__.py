"""Compilation of the kernels ahead of time, when a wheel is built; no part of a run.

numba lowers every entry once (``lowering``), LLVM optimises all of them together and emits an object file for each
target (``objects``), its undefined symbols are compared to a list (``symbols``), and the compiler of ``ziglang``
links it with a few lines of C (``linking``). ``python -m latin_fmu.aot`` builds the library into ``build/`` of a
source tree, where the package finds it: of use after a change of a kernel.
"""
