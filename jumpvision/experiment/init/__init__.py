"""A first experiment.toml from a folder of recordings: recognise them, ask nothing, write what is known."""
