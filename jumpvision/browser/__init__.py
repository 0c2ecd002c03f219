"""Pages served on this machine: the interactive jumper, the workbench."""
