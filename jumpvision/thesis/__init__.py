"""The analyses of the thesis (Aguilar) and of plans, over maps of jumps, with their figures and pages."""
