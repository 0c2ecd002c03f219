"""The analyses of jumps on sand: chapter III of the thesis."""
