"""The LATIN method: two groups of equations, two search directions, over windows of time, Eqs. (8)-(17), (24)."""
