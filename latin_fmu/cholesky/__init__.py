"""Sparse Cholesky factorisation of symmetric positive definite matrices, some dofs (an interface) kept for last.

============  =======================================================================================================
symbolic      ordering, quotient graph of nodes, pattern of the factor
tree          elimination tree, column counts, supernodes, their rows
numeric       multifrontal factorisation, dense fronts with BLAS and LAPACK
substitution  forward and backward substitution, one vector or eight at a time
factor        the factor with half solves and the dense Schur complement of the interface; the same with SciPy's
              sparse LU where nothing is compiled, and of diagonal matrices
============  =======================================================================================================

The factor is compared with dense Cholesky in ``tests/cholesky``, its speed with CHOLMOD in
``examples/benchmarks/against_cholmod.py``. References:

* T. A. Davis, *Direct Methods for Sparse Linear Systems*, SIAM, 2006: elimination tree, row subtrees, column counts
  and postorder (chapter 4), minimum degree and nested dissection (chapter 7).
* J. W. H. Liu, "The multifrontal method for sparse matrix solution", *SIAM Review* 34 (1992) 82-109: fronts, updates
  on a stack.
* C. Ashcraft, R. Grimes, "The influence of relaxed supernode partitions on the multifrontal method", *ACM Transactions
  on Mathematical Software* 15 (1989) 291-309: supernodes that hold some zeros.
* J. W. H. Liu, "Modification of the minimum-degree algorithm by multiple elimination", *ACM Transactions on
  Mathematical Software* 11 (1985) 141-153: the ordering where none is given, as SuperLU in SciPy computes it.
"""
