"""Stages of the bed: its height, its crater, its walls and air, slow intrusions."""
