"""The bench behind the terminals: plant, motor, sensors, operator, camera, wiring and clock."""
