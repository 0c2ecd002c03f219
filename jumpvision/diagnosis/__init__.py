"""What a simulation gets wrong, why, and what mends it: statistics over any system of one-dimensional motions."""
