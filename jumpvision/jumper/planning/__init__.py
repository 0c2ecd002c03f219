"""Motor trajectories for a jump: direct collocation of the jumper's equations (thesis section 3.5)."""
