"""Laws of interfaces, one file each: value, tangent, status and parameters; ``dispatch`` has their registry."""
