"""One way to run: stages, the workspace that keeps their results, a campaign's run, its cache, a cluster."""
