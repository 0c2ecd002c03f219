"""Statistics of measurements, arrays in, estimates out: from tracks, logs and profiles, with uncertainties."""
