"""jumpvision: from films of a jumping robot to tracks, fields, forces and tested models."""

__version__ = "0.1.0"
