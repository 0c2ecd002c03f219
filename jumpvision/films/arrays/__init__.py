"""Arrays in, tables and data sets out: `jv.piv(a, b)` and its like. Stages call the same code."""
