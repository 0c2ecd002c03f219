"""Figures of the analyses of the thesis."""
