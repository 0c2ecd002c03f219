"""A campaign questioned: from result folders to diagnosis.json and the extended model.toml."""

STAGES = ("rod", "bed", "flow", "fit")  # whose results a diagnosis reads
