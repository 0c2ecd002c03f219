"""The laboratory's films and pictures, drawn without a line of what analyses them."""
