"""What only many experiments show: craters against packing, intrusions, the actuator, the diagnosis."""
