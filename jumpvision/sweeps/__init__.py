"""Maps of jumps over any axes, measured heights beside simulated ones, plans; with their figures."""
