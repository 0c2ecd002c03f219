"""Stages of the grain film: velocities, strain and momentum, the column and the cone under the foot."""
