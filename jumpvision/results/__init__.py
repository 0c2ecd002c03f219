"""What stages hand on, as types; a dict only at the file."""
