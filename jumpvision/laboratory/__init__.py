"""The virtual laboratory: recordings with known truth. It imports nothing that analyses them."""
