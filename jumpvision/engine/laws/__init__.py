"""Laws of force as text: read, checked, and turned into functions."""
