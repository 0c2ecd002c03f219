"""What the experiments beside the jumps of a campaign measured: craters, slow intrusions, the actuator."""
