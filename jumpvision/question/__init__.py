"""A campaign questioned: from result folders to diagnosis.json and the extended model.toml."""
