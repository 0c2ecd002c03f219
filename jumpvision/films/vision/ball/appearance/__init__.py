"""Targets that are no plain discs: followed as a picture."""
