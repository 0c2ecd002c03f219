"""What stages hand on, as types; a dict only at the file: `tables`, `fields`, `values`, and here what each can do.

A record holds its data in the form users know: `.table` (pandas), `.field` (xarray) or `.values` (plain dict).
"""
