"""A folder of recordings becomes numbers: inputs, stages with a cache, campaigns, result files."""
