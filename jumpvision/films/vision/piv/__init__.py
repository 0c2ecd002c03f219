"""Particle image velocimetry of grain films: pixels and frames in, displacement fields with uncertainty out."""
