"""Real machines that benchmarks measure by."""
