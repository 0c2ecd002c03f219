"""The workbench: look at films and logs, click what is known, watch the tracker, correct it, write experiment.toml."""
