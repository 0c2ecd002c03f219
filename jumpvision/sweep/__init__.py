"""Experiments as commands: axes and a robot to jumps at every point, as an xarray data set in sweep.nc."""
