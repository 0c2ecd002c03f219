"""The noise of a campaign, from everything that needs no model."""
