"""The jumper as a system that can be questioned."""
