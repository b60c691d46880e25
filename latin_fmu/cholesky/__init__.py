"""Supernodal Cholesky factorisation with half solves, interface dofs last."""
