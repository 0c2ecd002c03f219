"""The analyses of the thesis and the plans of jumps: sweeps over any axes, and their numbers."""
