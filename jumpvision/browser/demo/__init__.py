"""The interactive jumper: a page in the browser that asks this package's solvers (thesis Fig 34)."""
